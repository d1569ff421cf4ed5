"""A synthetic CT volume of platelets with known fibre direction and normal, made slab by slab.

The stack has coordinates of its own: x, y in the layers and w through them. A wavy layer is the flat one lifted by a
smooth height h(x, y); streaks depend only on the coordinate across the fibres and on w, so their tangent is exactly
``p = (cos a, sin a, h_x cos a + h_y sin a)`` and the layers' normal exactly ``r = (-h_x, -h_y, 1)``, both normalised.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.filters import gaussian
from ppmc.ct.layup import STAGE, Layup
from ppmc.ct.paint import paint_slab, paint_voids
from ppmc.ct.texture import STEPS_PER_WAVELENGTH, streak_table
from ppmc.files import VoxelGrid
from ppmc.scene.sections.phantom import PhantomSection

WAVES = 6
SLAB_BYTES = 64 * 2**20
BYTES_PER_VOXEL = 60
GREY = {"uint8": (128.0, 20.0, 0, 255), "uint16": (30000.0, 3000.0, 0, 65535), "float32": (0.0, 1.0, -np.inf, np.inf)}
"""Grey value of a platelet's mean, grey values per unit of contrast, and the range of the type."""


@dataclass(frozen=True)
class Slab:
    """Some planes of the phantom: the fields of the volume contract, arrays (nz, ny, nx[, 3])."""

    first: int
    fields: dict[str, NDArray[np.generic]]


class Phantom:
    """The phantom of a scene.

    Parameters
    ----------
    section : PhantomSection
        What to make.
    seed : int
        Seed of all random draws.

    Attributes
    ----------
    grid : VoxelGrid
        The voxels, the margin of air included.
    """

    def __init__(self, section: PhantomSection, seed: int) -> None:
        self.section = section
        h = np.array(section.spacing)
        cavity: NDArray[np.float64] = np.array(section.cavity)
        border = np.ceil(section.margin / h - 1e-9)
        counts = np.maximum(np.round(cavity / h), 1) + 2 * border
        self.low: NDArray[np.float64] = np.array(section.origin)
        self.high = self.low + cavity
        first = self.low + (0.5 - border) * h
        nx, ny, nz = (int(n) for n in counts)
        self.grid = VoxelGrid((nz, ny, nx), section.spacing, (float(first[0]), float(first[1]), float(first[2])))
        rng = np.random.default_rng([seed, STAGE])
        self._seed = seed
        self._centre = 0.5 * (self.low + self.high)
        self._turn = _rotation(*section.tilt)
        self._waves = _waves(section, rng)
        self._table = streak_table(rng)
        self._layup, self._floor = self._stack()
        self._voids = self._scatter_voids(rng)

    def slabs(self) -> Iterator[Slab]:
        """Yield the phantom from bottom to top, as many planes at a time as fit in a few tens of MB."""
        nz, ny, nx = self.grid.shape
        planes = max(1, min(nz, SLAB_BYTES // (BYTES_PER_VOXEL * ny * nx)))
        for first in range(0, nz, planes):
            yield self._slab(first, min(planes, nz - first))

    def _stack(self) -> tuple[Layup, float]:
        """Return the layers that fill the cavity, and the height of the lowest one's underside in the stack."""
        half = 0.5 * (self.high - self.low)
        corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) * half
        reach = np.abs(corners @ self._turn).max(axis=0)
        # Blurring looks a little beyond the cavity, and waves lift layers from below into it.
        lift = float(np.abs(self._waves[:, 3]).sum()) + 4.0 * self._blur * max(self.section.spacing)
        thickness = self.section.platelet.thickness
        below = math.ceil((reach[2] - half[2] + lift) / thickness)
        floor = -half[2] - below * thickness
        count = math.ceil((reach[2] + lift - floor) / thickness) + 1
        lower, upper = (-reach[0], -reach[1]), (reach[0], reach[1])
        return Layup(self.section, self._seed, lower, upper, count, below), float(floor)

    @property
    def _blur(self) -> float:
        """Blur in voxels of the smallest edge."""
        h = min(self.section.spacing)
        return 0.6 if self.section.blur is None else self.section.blur / h

    def _scatter_voids(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return voids (n, 5) between layers: centre, in-plane radius, half height."""
        section = self.section
        diameter = section.void_diameter or 2.0 * section.platelet.thickness
        spread = 0.3
        mean = math.pi / 6.0 * diameter**3 / 3.0 * math.exp(4.5 * spread**2)
        n = round(section.void_fraction * float(np.prod(self.high - self.low)) / mean)
        place = self.low + rng.random((n, 3)) * (self.high - self.low)
        radius = 0.5 * diameter * np.exp(spread * rng.standard_normal(n))
        stack = (place - self._centre) @ self._turn
        height = _heights(stack, self._waves)
        faces = np.round((stack[:, 2] - height - self._floor) / section.platelet.thickness)
        stack[:, 2] = self._floor + faces * section.platelet.thickness + height
        return np.column_stack([stack @ self._turn.T + self._centre, radius, radius / 3.0])

    def _slab(self, first: int, planes: int) -> Slab:
        section = self.section
        taps = [gaussian(self._blur * min(section.spacing) / h) for h in section.spacing]
        halo = [len(t) // 2 for t in taps]
        _, ny, nx = self.grid.shape
        shape = (planes + 2 * halo[2], ny + 2 * halo[1], nx + 2 * halo[0])
        spacing = np.array(section.spacing)
        start = np.array(self.grid.origin) + spacing * (-halo[0], -halo[1], first - halo[2])
        grey = np.empty(shape, np.float32)
        platelet = np.empty(shape, np.int32)
        fibre = np.empty((*shape, 3), np.float32)
        normal = np.empty((*shape, 3), np.float32)
        bottom, top = self._layers_between(start, spacing, shape)
        layers = self._layup.layers(bottom, top)
        records = np.concatenate([layer.records for layer in layers])
        ids = np.concatenate([[0], np.cumsum([len(layer.records) for layer in layers])])
        # Without a margin the volume is cut out of a larger block; with one, air lies around it.
        low, high = (self.low, self.high) if section.margin > 0 else (np.full(3, -np.inf), np.full(3, np.inf))
        film = min(section.spacing) if section.resin_thickness is None else section.resin_thickness
        wavelength = section.streak_wavelength or 5.0 * max(section.spacing[:2])
        paint_slab(
            start, spacing, self._centre, self._turn, self._waves, self._floor, section.platelet.thickness, bottom,
            np.array(self._layup.lower), self._layup.cell, np.stack([layer.owner for layer in layers]), ids, records,
            self._table, STEPS_PER_WAVELENGTH / wavelength, section.streak_flatness, section.streak_contrast, film,
            section.resin_contrast, low, high, grey, platelet, fibre, normal,
        )  # fmt: skip
        grey[platelet == -2] = -section.void_contrast
        paint_voids(start, spacing, self._turn, self._voids, section.void_contrast, grey, platelet, fibre, normal)
        inner = tuple(slice(r, r + n) for r, n in zip(halo[::-1], (planes, ny, nx), strict=True))
        number = platelet[inner]
        real = number >= 0
        return Slab(
            first,
            {
                "grey": self._recorded(_blurred(grey, taps, halo), first),
                "mask": (number > -2).astype(np.uint8),
                "fibre_direction": np.ascontiguousarray(fibre[inner]),
                "platelet_normal": np.ascontiguousarray(normal[inner]),
                "platelet_id": np.where(real, number + int(self._layup.first_id[bottom]), -1).astype(np.int32),
            },
        )

    def _layers_between(
        self, start: NDArray[np.float64], spacing: NDArray[np.float64], shape: tuple[int, int, int]
    ) -> tuple[int, int]:
        """Return the first and last layer that a slab can touch."""
        end = start + spacing * (np.array(shape[::-1]) - 1)
        corners = np.array(
            [[x, y, z] for x in (start[0], end[0]) for y in (start[1], end[1]) for z in (start[2], end[2])]
        )
        w = (corners - self._centre) @ self._turn[:, 2] - self._floor
        lift = np.abs(self._waves[:, 3]).sum()
        thickness = self.section.platelet.thickness
        bottom = math.floor((w.min() - lift) / thickness)
        top = math.floor((w.max() + lift) / thickness)
        last = self._layup.count - 1
        return min(max(bottom, 0), last), min(max(top, 0), last)

    def _recorded(self, value: NDArray[np.float32], first: int) -> NDArray[np.generic]:
        """Add noise, plane by plane from a seed of its own, and convert to the grey type."""
        middle, unit, least, most = GREY[self.section.grey_type]
        for k in range(len(value)):
            rng = np.random.default_rng([self._seed, STAGE, 1, first + k])
            value[k] += self.section.noise * rng.standard_normal(value[k].shape, dtype=np.float32)
        value = middle + unit * value
        if self.section.grey_type == "float32":
            return value.astype(np.float32)
        return np.clip(np.rint(value), least, most).astype(self.section.grey_type)


def _blurred(grey: NDArray[np.float32], taps: list[NDArray[np.float32]], halo: list[int]) -> NDArray[np.float32]:
    """Blur along each axis and cut the halo off; taps and halo in the order x, y, z."""
    for axis, t, radius in ((2, taps[0], halo[0]), (1, taps[1], halo[1]), (0, taps[2], halo[2])):
        n = grey.shape[axis] - 2 * radius
        part = [slice(None)] * 3
        total = np.zeros([n if a == axis else m for a, m in enumerate(grey.shape)], np.float32)
        for shift, c in enumerate(t):
            part[axis] = slice(shift, shift + n)
            total += c * grey[tuple(part)]
        grey = total
    return grey


def _rotation(about_x: float, about_y: float) -> NDArray[np.float64]:
    """Return the rotation about x, then about y; degrees."""
    a, b = np.radians([about_x, about_y])
    turn_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    turn_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return np.asarray(turn_y @ turn_x)


def _waves(section: PhantomSection, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return waves (n, 4) (kx, ky, phase, amplitude) whose slope has the root mean square asked for."""
    if section.waviness == 0.0:
        return np.zeros((0, 4))
    wavelength = (section.waviness_length or 3.0 * section.platelet.length) * np.exp(0.2 * rng.standard_normal(WAVES))
    angle = (np.arange(WAVES) + rng.random(WAVES)) * np.pi / WAVES
    k = 2.0 * np.pi / wavelength
    # n waves of slope amplitude s have a mean square slope of n s^2 / 2
    slope = math.tan(math.radians(section.waviness)) * math.sqrt(2.0 / WAVES)
    phase = 2.0 * np.pi * rng.random(WAVES)
    return np.column_stack([k * np.cos(angle), k * np.sin(angle), phase, slope / k])


def _heights(stack: NDArray[np.float64], waves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the height of the wavy layers at points (n, 3) of the stack."""
    phase = stack[:, :2] @ waves[:, :2].T + waves[:, 2]
    return np.asarray(np.sin(phase) @ waves[:, 3])
