"""How fast this machine is, in a twentieth of a second: a sparse product that asks for what the solver asks for."""

from __future__ import annotations

from time import process_time

import numpy as np

ROWS, NEIGHBOURS, ROUNDS = 20_000, 70, 9
# CPU time of one such product on the machine of docs/benchmarks/solver.md, s.
REFERENCE = 1.4e-3


def relative_speed() -> float:
    """Return the speed of one core over that on which the solver was measured.

    The product gathers as many neighbours from as far in memory as the solver's, and takes no compiled kernel. The
    fastest of a few rounds counts, by CPU time, so that other work on the machine hardly shows. It is measured anew
    each time, for that costs less than to find out whether a kept value still holds.
    """
    from scipy.sparse import csr_array

    column = (np.arange(ROWS)[:, None] + np.arange(NEIGHBOURS) * 37) % ROWS
    starts = np.arange(0, ROWS * NEIGHBOURS + 1, NEIGHBOURS)
    matrix = csr_array((np.ones(ROWS * NEIGHBOURS), column.ravel(), starts), shape=(ROWS, ROWS))
    vector = np.ones(ROWS)
    spent = []
    for _ in range(ROUNDS):
        begin = process_time()
        matrix @ vector
        spent.append(process_time() - begin)
    return REFERENCE / max(min(spent), 1e-6)
