"""Volume averages of p and r over regions: A, N of second and fourth order, with the spread.

Components of fourth order are kept as the 15 independent ones in lexicographic order (`FOURTH`): 1111, 1112, 1113,
1122, ..., 3333; the API gives the full 3x3x3x3 array. Sums are additive, so large files are averaged slab by slab.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import combinations_with_replacement, permutations

import numpy as np

from ppmc.analysis.averages.moments import N_SUMS, bin_points, sum_regions
from ppmc.analysis.averages.regions import Region, pack
from ppmc.orientation import from_six
from ppmc.particles import Particles

FOURTH = tuple(combinations_with_replacement((0, 1, 2), 4))
_SCATTER = np.zeros((3, 3, 3, 3), dtype=np.int64)
for _k, _combination in enumerate(FOURTH):
    for _index in permutations(_combination):
        _SCATTER[_index] = _k


@dataclass(frozen=True)
class RegionSums:
    """Raw weighted sums over each region; add two of them to join disjoint sets of points."""

    regions: tuple[Region, ...]
    sums: np.ndarray

    def __add__(self, other: RegionSums) -> RegionSums:
        total = self.sums + other.sums
        # A platelet may lie in both parts, and then its square is not the sum of squares.
        shared = (self.sums[:, 0] > 0) & (other.sums[:, 0] > 0)
        total[shared, 50] = 0.0
        return RegionSums(self.regions, total)

    def averages(self) -> RegionAverages:
        """Return the averages; NaN where a region holds nothing."""
        s = self.sums
        with np.errstate(invalid="ignore", divide="ignore"):
            volume = s[:, 1]
            fibre, normal = s[:, 6:7], s[:, 28:29]
            return RegionAverages(
                regions=self.regions,
                particle_count=s[:, 0].astype(np.int64),
                material_volume=volume.copy(),
                effective_count=volume**2 / s[:, 2],
                effective_platelets=np.where(s[:, 50] > 0, volume**2 / s[:, 50], np.nan),
                centroid=s[:, 3:6] / s[:, 1:2],
                known_share=fibre[:, 0] / volume,
                fibre_tensor=from_six(s[:, 7:13] / fibre),
                normal_tensor=from_six(s[:, 29:35] / normal),
                fibre_tensor4=(s[:, 13:28] / fibre)[:, _SCATTER],
                normal_tensor4=(s[:, 35:50] / normal)[:, _SCATTER],
            )


@dataclass(frozen=True)
class RegionAverages:
    """Averages over m regions; every entry of an empty region is NaN, its count and volume zero.

    Attributes
    ----------
    particle_count : ndarray, shape (m,)
        Points in the region.
    material_volume : ndarray, shape (m,)
        Their volume, mm³.
    effective_count : ndarray, shape (m,)
        (Σw)²/Σw²: the number of equal points that would average as well.
    effective_platelets : ndarray, shape (m,)
        The same counting every platelet once: points of one platelet are no independent samples. NaN if not known.
    centroid : ndarray, shape (m, 3)
        Their centre of volume, mm.
    known_share : ndarray, shape (m,)
        Share of the volume whose fibre direction is known.
    fibre_tensor, normal_tensor : ndarray, shape (m, 3, 3)
        A = <p p> and N = <r r>.
    fibre_tensor4, normal_tensor4 : ndarray, shape (m, 3, 3, 3, 3)
        𝔸 = <p p p p> and ℕ = <r r r r>, fully symmetric.
    """

    regions: tuple[Region, ...]
    particle_count: np.ndarray
    material_volume: np.ndarray
    effective_count: np.ndarray
    effective_platelets: np.ndarray
    centroid: np.ndarray
    known_share: np.ndarray
    fibre_tensor: np.ndarray
    normal_tensor: np.ndarray
    fibre_tensor4: np.ndarray
    normal_tensor4: np.ndarray

    def __len__(self) -> int:
        return len(self.regions)

    def __getitem__(self, index: slice) -> RegionAverages:
        """Return the averages of some of the regions (slices only)."""
        return RegionAverages(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @property
    def fibre_spread(self) -> np.ndarray:
        """Standard deviation of p_i p_j over the region, shape (m, 3, 3)."""
        return _spread(self.fibre_tensor, self.fibre_tensor4)

    @property
    def normal_spread(self) -> np.ndarray:
        """Standard deviation of r_i r_j over the region, shape (m, 3, 3)."""
        return _spread(self.normal_tensor, self.normal_tensor4)

    @property
    def fibre_error(self) -> np.ndarray:
        """Standard error of A, shape (m, 3, 3): spread over the root of the effective number of platelets."""
        return np.asarray(self.fibre_spread / np.sqrt(self.effective_platelets)[:, None, None])

    @property
    def normal_error(self) -> np.ndarray:
        """Standard error of N, shape (m, 3, 3)."""
        return np.asarray(self.normal_spread / np.sqrt(self.effective_platelets)[:, None, None])

    @property
    def region_volume(self) -> np.ndarray:
        """Geometric volume of each region, mm³; infinite for unbounded regions."""
        return np.array([region.volume for region in self.regions])


def region_sums(samples: Particles, regions: list[Region] | tuple[Region, ...]) -> RegionSums:
    """Sum the moments of the samples over every region; see `region_averages`."""
    regions = tuple(regions)
    if not len(samples) or not regions:
        return RegionSums(regions, np.zeros((len(regions), N_SUMS)))
    binned = bin_points(
        samples.positions, samples.volume, samples.fibre_direction, samples.platelet_normal, samples.platelet_id
    )
    return RegionSums(regions, sum_regions(binned, pack(regions)))


def region_averages(samples: Particles, regions: list[Region] | tuple[Region, ...]) -> RegionAverages:
    """Average p⊗p, r⊗r and their fourth-order kin over each region, weighted by volume.

    Parameters
    ----------
    samples : Particles
        Points with volume and directions.
    regions : sequence of Region
        They may overlap and lie anywhere.

    Returns
    -------
    RegionAverages
        NaN for empty regions, and for N where the samples carry no platelet normal.

    Notes
    -----
    A_ij = Σ V p_i p_j / Σ V and so on (J section II.A). Points are sorted into cells once, each region is then summed
    by one thread in a fixed order: the result does not depend on the number of threads.
    """
    return region_sums(samples, regions).averages()


def in_frames(averages: RegionAverages, frames: np.ndarray) -> RegionAverages:
    """Express the tensors of each region in its own axes.

    Parameters
    ----------
    averages : RegionAverages
        Averages of m regions in tool coordinates.
    frames : ndarray, shape (m, 3, 3)
        Rows are the local unit axes: Ā = R·A·Rᵀ (D6).
    """

    def second(t: np.ndarray) -> np.ndarray:
        return np.einsum("mia,mjb,mab->mij", frames, frames, t)

    def fourth(t: np.ndarray) -> np.ndarray:
        return np.einsum("mia,mjb,mkc,mld,mabcd->mijkl", frames, frames, frames, frames, t, optimize=True)

    return RegionAverages(
        **{f.name: getattr(averages, f.name) for f in fields(averages) if "tensor" not in f.name},
        fibre_tensor=second(averages.fibre_tensor),
        normal_tensor=second(averages.normal_tensor),
        fibre_tensor4=fourth(averages.fibre_tensor4),
        normal_tensor4=fourth(averages.normal_tensor4),
    )


def fourth_components(tensor: np.ndarray) -> np.ndarray:
    """Return the 15 independent components, in the order `FOURTH`, of symmetric tensors (..., 3, 3, 3, 3)."""
    i, j, k, m = np.array(FOURTH).T
    return np.asarray(tensor)[..., i, j, k, m]


def from_fourth(components: np.ndarray) -> np.ndarray:
    """Return symmetric tensors (..., 3, 3, 3, 3) from their 15 components in the order `FOURTH`."""
    return np.asarray(components)[..., _SCATTER]


def _spread(second: np.ndarray, fourth: np.ndarray) -> np.ndarray:
    variance = np.einsum("...ijij->...ij", fourth) - second**2
    # Round-off may leave -1e-17 for perfectly aligned material.
    return np.sqrt(np.where(variance < 0, 0.0, variance))
