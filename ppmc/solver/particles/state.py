"""The particles' state: everything that a run carries from step to step, and nothing that can be computed from it."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ppmc.compile_cache import njit, prange


@dataclass
class ParticleState:
    """Arrays with one row a particle, in the current (cell-sorted) order.

    Attributes
    ----------
    position : ndarray, shape (n, 3)
        mm.
    velocity : ndarray, shape (n, 3)
        Velocity of the last step, mm/s.
    velocity_gradient : ndarray, shape (n, 3, 3)
        Velocity gradient of the last step, 1/s.
    smooth_gradient : ndarray, shape (n, 3, 3)
        Running mean of the velocity gradient, 1/s.
    twice_smooth_gradient : ndarray, shape (n, 3, 3)
        Running mean of that mean; the two predict half-widths at the end of the next step.
    deformation_gradient : ndarray, shape (n, 3, 3)
        F since the start.
    volume_ratio : ndarray, shape (n,)
        J.
    fibre_direction : ndarray, shape (n, 3)
        p.
    in_plane_direction : ndarray, shape (n, 3)
        q-hat; kept but not moved when normals are not transported.
    volume : ndarray, shape (n,)
        Volume at the start, mm^3.
    reference_position : ndarray, shape (n, 3)
        Position at the start, mm.
    half_width : ndarray, shape (n, tools)
        Reference half-width towards each tool, mm.
    contact_tool : ndarray, shape (n, 3), int32
        Tools touched in the last step, -1 for none.
    contact_normal : ndarray, shape (n, 3, 3), float32
        Normals of the faces touched, only to know these again.
    contact_slip : ndarray, shape (n, 3)
        Speed over traction at the faces touched, mm/(Pa s), where a wall's law makes it depend on the sliding.
    wall_layers : ndarray, shape (n,)
        Number of faces in whose wall layer the particle is.
    lattice_shape, kernel_shape : ndarray, shape (n, 6)
        Shape tensors C of the local lattice and of the kernel's support, unit determinant.
    flow_residual : ndarray, shape (n,)
        Rate at which neighbours leave the motion of the gradient, in parts of the strain rate.
    packing_reference : ndarray, shape (n,)
        Packing of the charge at its start, to which it is held.
    platelet_id : ndarray, shape (n,)
    original : ndarray, shape (n,)
        Number of the particle in the charge.
    """

    position: np.ndarray
    velocity: np.ndarray
    velocity_gradient: np.ndarray
    smooth_gradient: np.ndarray
    twice_smooth_gradient: np.ndarray
    deformation_gradient: np.ndarray
    volume_ratio: np.ndarray
    fibre_direction: np.ndarray
    in_plane_direction: np.ndarray
    volume: np.ndarray
    reference_position: np.ndarray
    half_width: np.ndarray
    contact_tool: np.ndarray
    contact_normal: np.ndarray
    contact_slip: np.ndarray
    wall_layers: np.ndarray
    lattice_shape: np.ndarray
    kernel_shape: np.ndarray
    flow_residual: np.ndarray
    packing_reference: np.ndarray
    platelet_id: np.ndarray
    original: np.ndarray

    @classmethod
    def at_rest(
        cls, position: np.ndarray, volume: np.ndarray, fibre_direction: np.ndarray, in_plane_direction: np.ndarray,
        half_width: np.ndarray, platelet_id: np.ndarray | None = None, lattice_shape: np.ndarray | None = None,
    ) -> ParticleState:  # fmt: skip
        """Undeformed particles at rest; arguments are attributes of the class, `lattice_shape` (6,) one for all."""
        n = len(position)
        identity = np.broadcast_to(np.eye(3), (n, 3, 3))
        one = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) if lattice_shape is None else lattice_shape
        lattice = np.broadcast_to(one, (n, 6))
        return cls(
            position=np.array(position, dtype=np.float64),
            velocity=np.zeros((n, 3)),
            velocity_gradient=np.zeros((n, 3, 3)),
            smooth_gradient=np.zeros((n, 3, 3)),
            twice_smooth_gradient=np.zeros((n, 3, 3)),
            deformation_gradient=identity.copy(),
            volume_ratio=np.ones(n),
            fibre_direction=np.array(fibre_direction, dtype=np.float64),
            in_plane_direction=np.array(in_plane_direction, dtype=np.float64),
            volume=np.array(volume, dtype=np.float64),
            reference_position=np.array(position, dtype=np.float64),
            half_width=np.array(half_width, dtype=np.float64),
            contact_tool=np.full((n, 3), -1, dtype=np.int32),
            contact_normal=np.zeros((n, 3, 3), dtype=np.float32),
            contact_slip=np.full((n, 3), np.inf),
            wall_layers=np.zeros(n, dtype=np.int64),
            lattice_shape=lattice.copy(),
            kernel_shape=lattice.copy(),
            flow_residual=np.zeros(n),
            packing_reference=np.ones(n),
            platelet_id=np.full(n, -1, dtype=np.int64)
            if platelet_id is None
            else np.array(platelet_id, dtype=np.int64),
            original=np.arange(n),
        )

    def __len__(self) -> int:
        """Return the number of particles."""
        return len(self.position)

    def reorder(self, order: np.ndarray) -> None:
        """Permute all arrays."""
        for f in fields(self):
            setattr(self, f.name, self._rows(f.name, order))

    def in_charge_order(self) -> ParticleState:
        """Return a copy with its rows as the charge has them, which nothing can write to."""
        order = np.argsort(self.original)
        copy = ParticleState(**{f.name: self._rows(f.name, order) for f in fields(self)})
        for values in copy.arrays().values():
            values.flags.writeable = False
        return copy

    def _rows(self, name: str, order: np.ndarray) -> np.ndarray:
        values = np.ascontiguousarray(getattr(self, name))
        out = np.empty((len(order), *values.shape[1:]), values.dtype)
        _take_rows(values.reshape(len(values), -1), order, out.reshape(len(order), -1))
        return out

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all arrays by name, for a checkpoint."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def in_original_order(self, values: np.ndarray) -> np.ndarray:
        """Return `values`, shape (n, ...), sorted as the charge was."""
        out = np.empty_like(values)
        out[self.original] = values
        return out


@njit(cache=True, parallel=True)
def _take_rows(values, order, out):
    for i in prange(order.shape[0]):
        for c in range(values.shape[1]):
            out[i, c] = values[order[i], c]
