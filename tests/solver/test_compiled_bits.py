"""A run that compiles its kernels gives the same bits as one that finds them in the cache."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import hashlib
import numpy as np
from ppmc.solver.step.explicit import _opposing_force
from ppmc.solver.sph.gradient import moments_and_gradient
from ppmc.solver.particles.cells import sort_into_cells
from ppmc.solver.particles.neighbours import build_list, weigh_pairs
from tests.solver.blocks import lattice, unit_vectors
from ppmc.solver.sph.operator import assemble

x = lattice((9, 8, 7), jitter=0.2)
x = x[sort_into_cells(x, 2.86).order]
n = len(x)
one = np.ones(n)
pairs = weigh_pairs(build_list(x, 2.86, 0.13), x, 1.3)
velocities = np.sin(np.arange(3.0 * n)).reshape(-1, 3)
gradient = moments_and_gradient(pairs, x, one, velocities)
operator = assemble(pairs, x, one, one, 50.0 * one, np.full((n, 1), 400.0), unit_vectors(n))
forces = operator.apply(velocities), _opposing_force(operator, velocities, velocities[:, 0].copy())
print(hashlib.sha256(b"".join(a.tobytes() for a in (gradient, operator.inverse, *forces))).hexdigest())
"""


@pytest.mark.slow
def test_compiling_and_cached_runs_agree_to_the_last_bit(tmp_path):
    root = Path(__file__).parents[2]
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": path}
    environment.pop("NUMBA_CACHE_DIR", None)
    found = [
        subprocess.run([sys.executable, "-c", SCRIPT], env=environment, check=True, capture_output=True, text=True)
        for _ in range(2)
    ]
    assert any(tmp_path.rglob("*.nbc"))
    assert found[0].stdout == found[1].stdout
