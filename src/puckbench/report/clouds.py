"""Clouds for the viewer: subsampled, in 16-bit coordinates, decoded ones with their errors."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.seeding import generator
from puckbench.figures.style import FigureStyle
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.io.clouds import read_cloud
from puckbench.report.contents import Contents, Example
from puckbench.report.curves import codec_payload, rounded

if TYPE_CHECKING:
    import pandas as pd

BYTES_PER_POINT = 28 / 3
"""Of a decoded cloud in the page: three coordinates of two bytes and an error of one, in base64."""
DECADES = 3
"""Powers of ten that the colours of the errors cover, from the largest down."""
_STEPS = 65535
_LEAST_POINTS = 100
_SHARE = 0.999
_COLOUR_STOPS = 64
_COLOUR_MAPS = {"height": ("viridis", 0.2), "error": ("inferno", 0.25)}
"""Maps of the viewer, and where they begin: their dark ends do not show on its background."""


def viewer_payload(
    contents: Contents, metrics: pd.DataFrame | None, style: FigureStyle
) -> dict[str, Any]:
    """What the viewer shows: examples, plot styles of their codecs, colour maps."""
    clouds = sum(1 + sum(map(len, e.decoded.values())) for e in contents.examples)
    points = points_each(contents.points, clouds, contents.most_mb)
    codecs = style.ordered_codecs(c for example in contents.examples for c in example.decoded)
    return {
        "codecs": [codec_payload(name, style) for name in codecs],
        "maps": {name: _colours(*which) for name, which in _COLOUR_MAPS.items()},
        "examples": [_example(item, points, metrics, style) for item in contents.examples],
    }


def _example(
    example: Example, points: int, metrics: pd.DataFrame | None, style: FigureStyle
) -> dict[str, Any]:
    original = read_cloud(Path(example.original))
    coded = (
        (codec, rate, read_cloud(Path(file)).xyz)
        for codec, files in example.decoded.items()
        for rate, file in files.items()
    )
    decoded = shown_decoded(original, coded, points)
    payload = example_payload(shown_original(original, points), decoded, "scale" in original.about)
    for item in payload["decoded"]:
        item["bpp"] = _bpp(metrics, example, item["codec"], item["rate"])
    return {
        "title": f"{style.title(example.dataset)}: {example.cloud}",
        "opened": example.kind != "object",
        **payload,
    }


def _bpp(metrics: pd.DataFrame | None, example: Example, codec: str, rate: str) -> float | None:
    """Bits per point of one stream, where the results have it."""
    if metrics is None:
        return None
    wanted = {"dataset": example.dataset, "cloud": example.cloud, "codec": codec, "rate": rate}
    row = metrics[np.all([metrics[name] == value for name, value in wanted.items()], axis=0)]
    return float(f"{row['bpp'].iloc[0]:.4g}") if len(row) else None


def _colours(name: str, start: float) -> list[str]:
    import matplotlib
    from matplotlib.colors import to_hex

    shares = (start + (1 - start) * step / (_COLOUR_STOPS - 1) for step in range(_COLOUR_STOPS))
    return [to_hex(matplotlib.colormaps[name](share)) for share in shares]


@dataclass(frozen=True)
class Shown:
    """Points (n, 3) of a cloud that are shown, in metres, and how many the cloud has.

    errors: (n,) distance to the nearest original point in metres; None of an original.
    """

    xyz: Floats
    total: int
    errors: Floats | None = None


def points_each(most: int, clouds: int, most_mb: float) -> int:
    """Points of each cloud: `most`, or as many as fit into `most_mb` megabytes."""
    fitting = most_mb * 1e6 / (max(clouds, 1) * BYTES_PER_POINT)
    return max(_LEAST_POINTS, min(most, int(fitting)))


def subsampled(points: Floats, most: int, *names: str) -> Floats:
    """At most `most` of the points (n, 3), chosen at random; the same names choose the same."""
    if len(points) <= most:
        return points
    rows = generator(0, "report", *names).choice(len(points), most, replace=False)
    return points[np.sort(rows)]


def shown_original(original: PointCloud, most: int) -> Shown:
    """Points of the cloud that was coded, in metres."""
    return Shown(original.to_metres(subsampled(original.xyz, most, "original")), len(original))


def shown_decoded(
    original: PointCloud, decoded: Iterable[tuple[str, str, Floats]], most: int
) -> list[tuple[str, str, Shown]]:
    """Points of decoded clouds (codec, rate, (m, 3) in the original's frame), with their errors."""
    from pykdtree.kdtree import KDTree

    tree = KDTree(original.xyz)
    scale = float(original.about.get("scale", 1.0))
    found = []
    for codec, rate, points in decoded:
        chosen = subsampled(points, most, codec, rate)
        errors = tree.query(np.ascontiguousarray(chosen))[0] / scale
        shown = Shown(original.to_metres(chosen), len(points), errors)
        found.append((codec, rate, shown))
    return found


def example_payload(
    original: Shown, decoded: Sequence[tuple[str, str, Shown]], in_metres: bool
) -> dict[str, Any]:
    """One example of the viewer: its clouds, and the range of errors that colours stand for.

    The range is the same for all of its decoded clouds: up to what 99.9 % of the worst one's
    errors keep below, down from there by three powers of ten. ``highest`` is 0 where no cloud
    has an error.
    """
    known = [shown.errors for _, _, shown in decoded if shown.errors is not None]
    highest = max((float(np.quantile(errors, _SHARE)) for errors in known), default=0.0)
    return {
        "unit": "m" if in_metres else "grid units",
        "highest": rounded([highest])[0],
        "decades": DECADES,
        "original": cloud_payload(original, highest),
        "decoded": [
            {"codec": codec, "rate": rate, **cloud_payload(shown, highest)}
            for codec, rate, shown in decoded
        ],
    }


def cloud_payload(shown: Shown, highest: float) -> dict[str, Any]:
    """A cloud in base64: coordinates in 65,535 steps over its box, errors in 255 (see `levels`)."""
    low, high = shown.xyz.min(axis=0), shown.xyz.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    steps = np.rint((shown.xyz - low) * (_STEPS / extent)).astype("<u2")
    payload: dict[str, Any] = {
        "points": len(shown.xyz),
        "total": shown.total,
        "low": rounded(low, 7),
        "extent": rounded(extent, 7),
        "xyz": b64encode(steps.tobytes()).decode("ascii"),
    }
    if shown.errors is not None:
        payload["error"] = b64encode(levels(shown.errors, highest).tobytes()).decode("ascii")
        payload["quantiles"] = rounded(np.quantile(shown.errors, [0.5, 0.95]))
    return payload


def levels(errors: Floats, highest: float) -> Any:
    """Errors (n,) as uint8: 255 is `highest` or more, 1 three powers of ten less, 0 below that."""
    if highest == 0:
        return np.zeros(len(errors), np.uint8)
    with np.errstate(divide="ignore"):
        decades = np.log10(errors / highest)
    return np.clip(np.floor(255 + decades * (254 / DECADES)), 0, 255).astype(np.uint8)
