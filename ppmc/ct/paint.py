"""Paint slabs of the phantom: grey value, platelet and true directions of every voxel."""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from ppmc.compile_cache import njit


@njit
def _height(x, y, waves):
    """Return the height of the wavy layers above their flat place, and its slopes; waves (n, 4): kx, ky, phase, a."""
    h = 0.0
    hx = 0.0
    hy = 0.0
    for k in range(waves.shape[0]):
        phase = waves[k, 0] * x + waves[k, 1] * y + waves[k, 2]
        h += waves[k, 3] * np.sin(phase)
        slope = waves[k, 3] * np.cos(phase)
        hx += waves[k, 0] * slope
        hy += waves[k, 1] * slope
    return h, hx, hy


@njit
def _texture(table, u, w):
    """Interpolate the periodic table linearly at (u, w), both in cells."""
    n = table.shape[0]
    fu = np.floor(u)
    fw = np.floor(w)
    a = u - fu
    b = w - fw
    i = int(fu) % n
    j = int(fw) % n
    i1 = (i + 1) % n
    j1 = (j + 1) % n
    low = table[i, j] * (1.0 - b) + table[i, j1] * b
    high = table[i1, j] * (1.0 - b) + table[i1, j1] * b
    return low * (1.0 - a) + high * a


@njit(nogil=True)
def paint_slab(start, spacing, centre, turn, waves, floor, thickness, first_layer, lower, cell, owner, ids, records,
               table, per_cell, flatness, streak, film, resin, low, high, grey, platelet, fibre, normal):  # fmt: skip
    """Paint the voxels of a slab.

    Parameters
    ----------
    start, spacing : (3,) float64
        Centre of the slab's first voxel and voxel size (x, y, z), mm.
    centre, turn : (3,), (3, 3) float64
        Middle of the cavity, and rotation from the stack's axes to the tool's.
    waves : (n, 4) float64
        Waviness of the layers.
    floor, thickness, first_layer : float, float, int
        Height of the underside of layer 0 in the stack, thickness of a layer, index of the first layer at hand.
    lower, cell, owner, ids, records
        Corner and cell of the layers' rasters, owners (layers, ny, nx), number of each layer's first record,
        records of all layers at hand.
    table, per_cell, flatness, streak
        Streak texture, its cells per mm, its fineness through the thickness and its contrast.
    film, resin
        Thickness (mm) and contrast of the resin film.
    low, high : (3,) float64
        Corners of the cavity; outside is air (id -2).
    grey, platelet, fibre, normal
        Filled: float32 (nz, ny, nx), int32 row of ``records`` (-1 resin, -2 air), float32 (nz, ny, nx, 3) twice.
    """
    nz, ny, nx = grey.shape
    layers = owner.shape[0]
    for k in range(nz):
        z = start[2] + k * spacing[2]
        for j in range(ny):
            y = start[1] + j * spacing[1]
            for i in range(nx):
                x = start[0] + i * spacing[0]
                fibre[k, j, i, :] = 0.0
                normal[k, j, i, :] = 0.0
                outside = x < low[0] or y < low[1] or z < low[2] or x > high[0] or y > high[1] or z > high[2]
                if outside:
                    platelet[k, j, i] = -2
                    grey[k, j, i] = 0.0
                    continue
                dx = x - centre[0]
                dy = y - centre[1]
                dz = z - centre[2]
                sx = turn[0, 0] * dx + turn[1, 0] * dy + turn[2, 0] * dz
                sy = turn[0, 1] * dx + turn[1, 1] * dy + turn[2, 1] * dz
                sz = turn[0, 2] * dx + turn[1, 2] * dy + turn[2, 2] * dz
                h, hx, hy = _height(sx, sy, waves)
                w = sz - h - floor
                layer = int(np.floor(w / thickness))
                face = w - layer * thickness
                face = min(face, thickness - face)
                layer = min(max(layer - first_layer, 0), layers - 1)
                ci = min(max(int((sx - lower[0]) / cell), 0), owner.shape[2] - 1)
                cj = min(max(int((sy - lower[1]) / cell), 0), owner.shape[1] - 1)
                own = owner[layer, cj, ci]
                if own < 0:
                    platelet[k, j, i] = -1
                    grey[k, j, i] = -resin
                    continue
                row = ids[layer] + own
                platelet[k, j, i] = row
                px = sx - records[row, 0]
                py = sy - records[row, 1]
                c = records[row, 2]
                s = records[row, 3]
                across = c * py - s * px
                edge = min(records[row, 4] - abs(c * px + s * py), records[row, 5] - abs(across))
                edge = min(edge, face)
                value = records[row, 6]
                value += streak * _texture(
                    table, (across + 977.0 * records[row, 7]) * per_cell, w * per_cell * flatness
                )
                # the film is shared half and half by the two platelets that meet
                if film > 0.0:
                    share = np.exp(-((2.0 * edge / film) ** 2))
                    value = value * (1.0 - share) - resin * share
                grey[k, j, i] = value
                rise = hx * c + hy * s
                length = np.sqrt(1.0 + rise * rise)
                steep = np.sqrt(1.0 + hx * hx + hy * hy)
                for a in range(3):
                    fibre[k, j, i, a] = (turn[a, 0] * c + turn[a, 1] * s + turn[a, 2] * rise) / length
                    normal[k, j, i, a] = (turn[a, 2] - turn[a, 0] * hx - turn[a, 1] * hy) / steep


@njit(nogil=True)
def paint_voids(start, spacing, turn, voids, air, grey, platelet, fibre, normal):
    """Cut voids out of a slab; ``voids`` (n, 5): centre (x, y, z), in-plane radius, half height, mm."""
    nz, ny, nx = grey.shape
    for v in range(voids.shape[0]):
        radius = voids[v, 3]
        height = voids[v, 4]
        k0 = max(0, int(np.ceil((voids[v, 2] - radius - start[2]) / spacing[2])))
        k1 = min(nz, int(np.floor((voids[v, 2] + radius - start[2]) / spacing[2])) + 1)
        j0 = max(0, int(np.ceil((voids[v, 1] - radius - start[1]) / spacing[1])))
        j1 = min(ny, int(np.floor((voids[v, 1] + radius - start[1]) / spacing[1])) + 1)
        i0 = max(0, int(np.ceil((voids[v, 0] - radius - start[0]) / spacing[0])))
        i1 = min(nx, int(np.floor((voids[v, 0] + radius - start[0]) / spacing[0])) + 1)
        for k in range(k0, k1):
            dz = start[2] + k * spacing[2] - voids[v, 2]
            for j in range(j0, j1):
                dy = start[1] + j * spacing[1] - voids[v, 1]
                for i in range(i0, i1):
                    dx = start[0] + i * spacing[0] - voids[v, 0]
                    up = turn[0, 2] * dx + turn[1, 2] * dy + turn[2, 2] * dz
                    flat = dx * dx + dy * dy + dz * dz - up * up
                    if flat / (radius * radius) + up * up / (height * height) <= 1.0 and platelet[k, j, i] > -2:
                        grey[k, j, i] = -air
                        platelet[k, j, i] = -1
                        fibre[k, j, i, :] = 0.0
                        normal[k, j, i, :] = 0.0
