"""What no charge can be: particles upon each other, or larger than the room that their neighbours leave."""

import numpy as np

from ppmc.errors import InputFileError
from ppmc.files import ParticleFile

LEAST_DISTANCE = 0.05  # of the spacing; a lattice has 1, a charge that was moved by another program still about a half
MOST_CELLS = 27.0  # a cube three spacings wide holds its neighbours' centres


def check_charge(charge: ParticleFile, spacing: np.ndarray, source: str) -> None:
    """Refuse a charge, which came from `source`, whose particles cannot lie side by side.

    Parameters
    ----------
    charge : ParticleFile
    spacing : ndarray, shape (3,)
        Of its lattice, mm.
    source : str
        Named in messages.

    Raises
    ------
    InputFileError
        Naming the first particles at fault.
    """
    volume, cell = charge.fields["volume"], float(np.prod(spacing))
    large = np.flatnonzero(volume > MOST_CELLS * cell)
    if len(large):
        k = int(large[0])
        raise InputFileError(
            f"{source}: /VTKHDF/PointData/volume[{k}] = {volume[k]:.6g} mm^3 is {volume[k] / cell:.3g} times the "
            f"{cell:.4g} mm^3 of a lattice cell, and would hold its neighbours; {len(large):,} of {len(volume):,} "
            "particles; correct the volumes"
        )
    from scipy.spatial import cKDTree

    pairs = cKDTree(charge.positions).query_pairs(LEAST_DISTANCE * float(spacing.min()), output_type="ndarray")
    if len(pairs):
        i, j = (int(k) for k in sorted(pairs[np.lexsort(pairs.T[::-1])][0]))
        where = ", ".join(f"{x:.5g}" for x in charge.positions[i])
        raise InputFileError(
            f"{source}: particles {i} and {j} are both at ({where}) mm; {len(pairs):,} such pairs: the charge is there "
            "twice, remove one of each"
        )
