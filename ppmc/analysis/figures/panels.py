"""What a view shows: squares of direction components, dominant direction, platelets, scalar maps of the flow."""

from __future__ import annotations

import numpy as np

from ppmc.analysis.figures.surfaces import dominant_surfaces
from ppmc.analysis.figures.views import Panel
from ppmc.analysis.flow.comparisons import Comparison
from ppmc.analysis.flow.kinematics import principal_stretches
from ppmc.files import FIELDS
from ppmc.particles import Particles

SYMBOLS = {"fibre_direction": "p", "platelet_normal": "r"}
HUES = 97


def squares(samples: Particles, name: str) -> list[Panel]:
    """Return p_i² or r_i² as three panels (J Figs 7 to 10); empty if the direction is not known."""
    direction = getattr(samples, name)
    if direction is None:
        return []
    symbol = SYMBOLS[name]
    return [Panel(f"${symbol}_{i + 1}^2$", direction[:, i] ** 2, f"${symbol}_i^2$ [–]") for i in range(3)]


def dominant(samples: Particles) -> list[Panel]:
    """Return three panels, each with only the points whose fibre lies nearest to that axis (A Fig 4.5)."""
    if samples.fibre_direction is None:
        return []
    share = samples.fibre_direction**2
    nearest = np.argmax(share, axis=1)
    counts = np.bincount(nearest, minlength=3)
    return [
        Panel(
            f"nearest to $x_{i + 1}$: {counts[i]:,} points" if counts[i] else f"nearest to $x_{i + 1}$: none",
            np.where(nearest == i, share[:, i], np.nan),
            "$p_i^2$ [–]",
        )
        for i in range(3)
    ]


def dominant_split(samples: Particles, spacing: float) -> list[Panel]:
    """Return three panels, each with the closed surface of the pieces whose fibres favour that axis (A Fig 4.5)."""
    if samples.fibre_direction is None:
        return []
    label, hidden = "$A_{ii}$ [–]", np.full(len(samples), np.nan)
    panels = []
    for i, surface in enumerate(dominant_surfaces(samples, spacing)):
        title = f"mostly along $x_{i + 1}$" + ("" if len(surface.points) else ": none")
        panels.append(Panel(title, hidden, label, (1.0 / 3.0, 1.0), surface=surface))
    return panels


def field_panel(samples: Particles, name: str) -> Panel:
    """Return a field as a panel from its least to its greatest value; of a vector or tensor its length."""
    values = np.asarray(samples.arrays()[name], dtype=float)
    units = {spec.name: spec.unit for product in ("charge", "flow") for spec in FIELDS[product]}
    shown = values if values.ndim == 1 else np.linalg.norm(values, axis=1)
    label = name.replace("_", " ") if values.ndim == 1 else f"|{name.replace('_', ' ')}|"
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    unit = units.get(name, "1")
    return Panel(label, shown, f"{label} [{'–' if unit == '1' else unit}]", (low, high if high > low else low + 1.0))


def differences(comparison: Comparison) -> list[Panel]:
    """Return how far each particle and its fibre are from those of another run; empty if they are not the same."""
    distance, angle = comparison.distance, comparison.angle
    if distance is None or angle is None:
        return []
    return [
        _panel("distance of each particle", distance, "|Δx| [mm]", floor=0.0, least=0.01),
        _panel("angle of its fibres", angle, "∠(p, p') [°]", floor=0.0, least=1.0),
    ]


def platelets(samples: Particles) -> list[Panel]:
    """Return one panel that tells platelets apart by colour; the colour has no other meaning."""
    ids = samples.platelet_id
    if ids is None or not (ids >= 0).any():
        return []
    hue = (ids.astype(np.int64) * 61 % HUES) / HUES
    return [Panel("platelets", np.where(ids >= 0, hue, np.nan), "")]


def scalar_maps(samples: Particles) -> list[Panel]:
    """Return panels of the largest principal stretch, the platelet shear angle and J, as far as the file has them."""
    panels = []
    F = samples.fields.get("deformation_gradient")
    if F is not None:
        largest = principal_stretches(F)[:, 2]
        panels.append(_panel("largest stretch", largest, "λ1 [–]", floor=1.0, least=0.01))
    shear = samples.fields.get("shear_angle")
    if shear is not None:
        panels.append(_panel("platelet shear angle", np.abs(shear), "|γ| [°]", floor=0.0, least=1.0))
    J = samples.fields.get("volume_ratio")
    if J is not None:
        reach = max(0.01, float(np.percentile(np.abs(J - 1.0), 99.0)))
        panels.append(Panel("volume ratio", J, "J [–]", (1.0 - reach, 1.0 + reach), "PuOr"))
    return panels


def _panel(title: str, values: np.ndarray, label: str, floor: float, least: float) -> Panel:
    """Return a panel whose colours reach to the 99th percentile, so that a few stray points do not wash it out.

    They span `least` at least, so that round-off does not look like a pattern.
    """
    top = float(np.percentile(values, 99.0)) if len(values) else floor
    return Panel(title, values, label, (floor, max(top, floor + least)))
