r"""Half-cells between the centres of a wall layer and a wall that rubs: drag, and where its power is lost.

A half-cell of width w shears with :math:`D = \mathrm{sym}(u\otimes n)/w`, where u is the velocity of the centre against
the material at the wall, along the wall. In its material this makes the traction :math:`C_t u/w` with

.. math:: C_t = \eta_{23}\,I + \sum_k 4\eta_{23}(R-1)\,v_k\,(p_k\cdot n)^2\,(P p_k)\otimes(P p_k), \qquad P = I - n n,

the part of the viscosity (J5) that a shear over planes with normal n meets. The wall passes the same traction on by its
own law, :math:`\lambda_f` times the velocity of the material against it (Navier), so that both give in series:

.. math:: t = \big(I/\lambda_f + w\,C_t^{-1}\big)^{-1}(v - v_{wall}) = C_t\,(w I + C_t/\lambda_f)^{-1}(v - v_{wall}).

A wall without slip is the limit of infinite friction, a slip wall that of none. Across the wall nothing is added: there
the contact holds the centre.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.walls.contact import Contacts

LEAST_WIDTH = 1e-300  # mm: only keeps an absent face from dividing by zero


def layer_drag(
    contacts: Contacts, slip_length: np.ndarray, area: np.ndarray, shear: np.ndarray, fibre: np.ndarray,
    directions: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Drag of each face on the centre of a particle at it, shape (m, 3, 3, 3), Pa s mm.

    Parameters
    ----------
    contacts : Contacts
    slip_length : ndarray, shape (m, 3)
        Inverse of the friction, mm/(Pa s): zero without slip, infinite where nothing rubs.
    area : ndarray, shape (m, 3)
        mm^2.
    shear : ndarray, shape (m,)
        eta23, Pa s.
    fibre : ndarray, shape (m, k)
        4 eta23 (R - 1) v_k, Pa s.
    directions : ndarray, shape (m, k, 3)
        Unit fibre directions p_k.
    """
    out = np.zeros((*slip_length.shape, 3, 3))
    _layer_drag(contacts.normal, contacts.half_width, slip_length, area, shear, fibre, directions, out)
    return out


def sheared(
    contacts: Contacts, slip_length: np.ndarray, area: np.ndarray, drag: np.ndarray, slide: np.ndarray,
    gradient: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """What goes on in the half-cells at walls that rub.

    Parameters
    ----------
    contacts, slip_length, area
        As in :func:`layer_drag`.
    drag : ndarray, shape (m, 3, 3, 3)
        See there.
    slide : ndarray, shape (m, 3, 3)
        Velocities of the centres against the wall of each face, mm/s.
    gradient : ndarray, shape (m, 3, 3)
        Velocity gradients at the centres, 1/s.

    Returns
    -------
    gradient : ndarray, shape (m, 3, 3)
        Those in the half-cells, 1/s: along the wall that of the centre, across it what centre and wall leave.
    power : ndarray, shape (m,)
        What their shear over the wall takes up, uN mm/s.
    """
    gradient, power = gradient.copy(), np.zeros(len(gradient))
    for k in range(slip_length.shape[1]):
        on = np.isfinite(slip_length[:, k])
        n, force = contacts.normal[on, k], np.einsum("nab,nb->na", drag[on, k], slide[on, k])
        along = slide[on, k] - np.einsum("na,na->n", slide[on, k], n)[:, None] * n
        along -= (slip_length[on, k] / area[on, k])[:, None] * force
        across = np.einsum("nab,nb->na", gradient[on], n)
        across -= np.einsum("na,na->n", across, n)[:, None] * n
        change = along / contacts.half_width[on, k, None] - across
        gradient[on] += change[:, :, None] * n[:, None, :]
        power[on] += np.einsum("na,na->n", force, along)
    return gradient, power


def brake(
    drag: np.ndarray, on: np.ndarray, wall_velocity: np.ndarray, time_per_mass: np.ndarray, velocities: np.ndarray
) -> np.ndarray:
    """Slow particles down in an explicit step; return the drag of each face on them, shape (m, 3, 3), Pa mm^2.

    The drag is that of the velocities after it, so that it is stable for any step.

    Parameters
    ----------
    drag : ndarray, shape (m, 3, 3, 3)
        See :func:`layer_drag`.
    on : ndarray, shape (m, 3), bool
        Faces that touch.
    wall_velocity : ndarray, shape (m, 3, 3)
        mm/s.
    time_per_mass : ndarray, shape (m,)
        Step over mass, mm/(Pa s mm^2).
    velocities : ndarray, shape (m, 3)
        mm/s, changed in place.
    """
    out = np.zeros_like(wall_velocity)
    _brake(drag, on, wall_velocity, time_per_mass, velocities, out)
    return out


@njit(cache=True)
def _tangents(n, t):
    axis = 0
    for c in range(1, 3):
        if abs(n[c]) < abs(n[axis]):
            axis = c
    size = np.sqrt(1.0 - n[axis] * n[axis])
    for c in range(3):
        t[0, c] = ((1.0 if c == axis else 0.0) - n[axis] * n[c]) / size
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        t[1, c] = n[a] * t[0, b] - n[b] * t[0, a]


@njit(cache=True, parallel=True)
def _layer_drag(normal, width, slip_length, area, shear, fibre, p, out):
    for i in prange(normal.shape[0]):
        t = np.empty((2, 3))
        for face in range(normal.shape[1]):
            slip = slip_length[i, face]
            if slip == np.inf:
                continue
            n = normal[i, face]
            _tangents(n, t)
            xx, yy, xy = shear[i], shear[i], 0.0
            for k in range(p.shape[1]):
                pn, pa, pb = 0.0, 0.0, 0.0
                for c in range(3):
                    pn += p[i, k, c] * n[c]
                    pa += p[i, k, c] * t[0, c]
                    pb += p[i, k, c] * t[1, c]
                stiff = fibre[i, k] * pn * pn
                xx += stiff * pa * pa
                yy += stiff * pb * pb
                xy += stiff * pa * pb
            # C (w I + s C)^-1 = (w C + s det C I) / det(w I + s C), for 2 x 2 matrices.
            w, det = max(width[i, face], LEAST_WIDTH), xx * yy - xy * xy
            per = area[i, face] / (w * w + w * slip * (xx + yy) + slip * slip * det)
            aa, bb, ab = per * (w * xx + slip * det), per * (w * yy + slip * det), per * w * xy
            for a in range(3):
                for b in range(3):
                    out[i, face, a, b] = (
                        aa * t[0, a] * t[0, b] + bb * t[1, a] * t[1, b] + ab * (t[0, a] * t[1, b] + t[1, a] * t[0, b])
                    )


@njit(cache=True, parallel=True)
def _brake(drag, on, wall, time_per_mass, velocities, out):
    for i in prange(velocities.shape[0]):
        matrix, pushed, touched = np.eye(3), velocities[i].copy(), False
        for k in range(on.shape[1]):
            if on[i, k]:
                touched = True
                for a in range(3):
                    for b in range(3):
                        matrix[a, b] += time_per_mass[i] * drag[i, k, a, b]
                        pushed[a] += time_per_mass[i] * drag[i, k, a, b] * wall[i, k, b]
        if not touched:
            continue
        velocities[i] = np.linalg.solve(matrix, pushed)
        for k in range(on.shape[1]):
            if on[i, k]:
                for a in range(3):
                    for b in range(3):
                        out[i, k, a] -= drag[i, k, a, b] * (velocities[i, b] - wall[i, k, b])
