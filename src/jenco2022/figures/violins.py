from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STEP_M = 0.05
_FEWEST_BINS, _MOST_BINS = 128, 4096


def draw_violin(axes: Axes, at: float, residuals: Floats, colour: str, width: float) -> None:
    bodies = axes.violin([violin_shape(residuals)], [at], widths=width, showmeans=True)
    parts: dict[str, Any] = dict(bodies)
    for body in parts.pop("bodies"):
        body.set(facecolor=colour, edgecolor="none", alpha=0.4)
    for line in parts.values():
        line.set(color=colour, linewidth=0.7)


def violin_shape(residuals: Floats) -> dict[str, Any]:
    """Return statistics of residuals (n,) for `Axes.violin`, with a Gaussian kernel of Scott's
    width.
    """
    low, high, std = float(residuals.min()), float(residuals.max()), float(residuals.std())
    shape: dict[str, Any] = {
        "mean": float(residuals.mean()),
        "median": float(np.median(residuals)),
        "min": low,
        "max": high,
    }
    if std <= 1e-12 * max(abs(low), abs(high)):
        return {**shape, "coords": np.array([low]), "vals": np.array([1.0])}
    coords, density = _density(residuals, std * len(residuals) ** -0.2)
    return {**shape, "coords": coords, "vals": density}


def _density(residuals: Floats, bandwidth: float) -> tuple[Floats, Floats]:
    low, high = float(residuals.min()), float(residuals.max())
    bins = int(np.clip(4 * (high - low) / bandwidth, _FEWEST_BINS, _MOST_BINS))
    density, edges = np.histogram(residuals, bins, (low, high), density=True)
    sigma = bandwidth / (edges[1] - edges[0])
    reach = min(math.ceil(4 * sigma), (bins - 1) // 2)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-9)) ** 2)
    smooth = np.convolve(density, kernel / kernel.sum(), mode="same")
    return (edges[1:] + edges[:-1]) / 2, np.asarray(smooth, dtype=np.float64)


def symmetric_limit(residuals: Floats, min_m: float) -> float:
    """Return the limit (m) of a symmetric axis: the extreme, rounded up to 5 cm, but at least
    `min_m`.
    """
    largest = float(np.abs(residuals).max(initial=0.0))
    if largest <= min_m:
        return min_m
    return math.ceil(largest / _STEP_M) * _STEP_M


def moments_text(residuals: Floats) -> str:
    mean, std = residuals.mean() + 0.0, residuals.std()
    return f"$\\mu$ = {_zero_unsigned(mean)}\n$\\sigma$ = {std:.3f}"


def _zero_unsigned(value: float) -> str:
    text = f"{value:.3f}"
    return "0.000" if text == "-0.000" else text.replace("-", "\u2212")
