"""Windows of the blocks of rows, in which forces on neighbours are summed, added in the order of the blocks."""

# mypy: disable-error-code="no-untyped-def"

from ppmc.compile_cache import njit, prange


@njit(cache=True, parallel=True)
def add_reactions(rows, low, offset, window, out):
    """Add the windows of all blocks to `out`."""
    blocks = rows.shape[0] - 1
    for target in prange(blocks):
        for block in range(blocks):
            shift = offset[block] - low[block]
            end = min(rows[target + 1], low[block] + offset[block + 1] - offset[block])
            for i in range(max(rows[target], low[block]), end):
                out[i, 0] += window[i + shift, 0]
                out[i, 1] += window[i + shift, 1]
                out[i, 2] += window[i + shift, 2]
