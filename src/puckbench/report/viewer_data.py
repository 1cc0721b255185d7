"""Clouds for the viewer: subsampled, in 16-bit coordinates, decoded ones with their errors."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.seeding import generator
from puckbench.figures.style import FigureStyle
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.io.archives import SUFFIX as ARCHIVE
from puckbench.io.clouds import read_archived_cloud, read_cloud
from puckbench.report.contents import Contents, Example
from puckbench.report.plot_data import codec_payload, rounded

if TYPE_CHECKING:
    import pandas as pd

BYTES_PER_POINT = 28 / 3
"""Of a decoded cloud in the page: three coordinates of two bytes and an error of one, in base64."""
MOST_DECADES = 3
"""Powers of ten that the colours of the errors cover at most, from the largest down."""
_LEAST_DECADES = 0.3
_STEPS = 65535
_LEAST_POINTS = 100
_SHARES = (0.02, 0.999)
"""Shares of a codec's errors at which the range of their colours begins and ends."""
_COLOUR_STOPS = 64
_COLOUR_MAPS = {"height": ("viridis", 0.2), "error": ("inferno", 0.25)}
"""Maps of the viewer, and where they begin: their dark ends do not show on its background."""


def viewer_payload(
    contents: Contents,
    metrics: pd.DataFrame | None,
    scan_errors: pd.DataFrame | None,
    style: FigureStyle,
) -> dict[str, Any]:
    """What the viewer shows: examples, plot styles of their codecs, colour maps.

    ``start`` is the pair that it begins with: see `most_telling`.
    """
    clouds = sum(1 + sum(map(len, e.decoded.values())) for e in contents.examples)
    points = points_each(contents.points, clouds, contents.most_mb)
    codecs = style.ordered_codecs(c for example in contents.examples for c in example.decoded)
    return {
        "codecs": [codec_payload(name, style) for name in codecs],
        "maps": {name: _colours(*which) for name, which in _COLOUR_MAPS.items()},
        "examples": [_example(item, points, metrics, style) for item in contents.examples],
        "start": most_telling(contents.examples, metrics, scan_errors),
    }


def most_telling(
    examples: Sequence[Example], metrics: pd.DataFrame | None, scan_errors: pd.DataFrame | None
) -> dict[str, Any]:
    """Example, codec and rate of the decoded cloud that is nearest to the truth, of all shown.

    Nearest beside its scan: that is where a codec takes most of the sensor's errors away. Where no
    truth is known, the last example, of which the viewer shows what it likes.
    """
    shown = [
        (number, codec, rate)
        for number, example in enumerate(examples)
        for codec, files in example.decoded.items()
        for rate in files
    ]
    gains = {pair: _gain(examples[pair[0]], *pair[1:], metrics, scan_errors) for pair in shown}
    known = {pair: gain for pair, gain in gains.items() if gain is not None}
    if not known:
        return {"example": len(examples) - 1}
    number, codec, rate = min(known, key=lambda pair: known[pair])
    return {"example": number, "codec": codec, "rate": rate}


def _gain(
    example: Example,
    codec: str,
    rate: str,
    metrics: pd.DataFrame | None,
    scan_errors: pd.DataFrame | None,
) -> float | None:
    """Squared distance of a decoded cloud to the truth over that of its scan."""
    names = {"dataset": example.dataset, "cloud": example.cloud}
    decoded = _value(metrics, "truth_cd_plane", **names, codec=codec, rate=rate)
    scan = _value(scan_errors, "truth_cd_plane", **names)
    return decoded / scan if decoded is not None and scan else None


def _value(table: pd.DataFrame | None, column: str, **wanted: str) -> float | None:
    """A column's value in the row of these names; None where there is none."""
    if table is None or column not in table:
        return None
    rows = table[np.all([table[name] == value for name, value in wanted.items()], axis=0)]
    known = rows[column].dropna()
    return float(known.iloc[0]) if len(known) else None


def _example(
    example: Example, points: int, metrics: pd.DataFrame | None, style: FigureStyle
) -> dict[str, Any]:
    original = read_cloud(Path(example.original))
    coded = (
        (codec, rate, _decoded(Path(file), rate).xyz)
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


def _decoded(file: Path, rate: str) -> PointCloud:
    """The decoded cloud of a rate, in a file or in an archive of several."""
    return read_archived_cloud(file, f"{rate}.ply") if file.suffix == ARCHIVE else read_cloud(file)


def _bpp(metrics: pd.DataFrame | None, example: Example, codec: str, rate: str) -> float | None:
    """Bits per point of one stream, where the results have it."""
    names = {"dataset": example.dataset, "cloud": example.cloud, "codec": codec, "rate": rate}
    value = _value(metrics, "bpp", **names)
    return None if value is None else float(f"{value:.4g}")


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
    """One example of the viewer: its clouds, and by codec the errors that colours stand for.

    ``ranges``: codec -> lowest and highest, the same for all of its rates: see `error_range`.
    """
    ranges = {name: error_range([s for c, _, s in decoded if c == name]) for name, _, _ in decoded}
    return {
        "unit": "m" if in_metres else "grid units",
        "ranges": {name: rounded(limits) for name, limits in ranges.items()},
        "original": cloud_payload(original),
        "decoded": [
            {"codec": codec, "rate": rate, **cloud_payload(shown, ranges[codec])}
            for codec, rate, shown in decoded
        ],
    }


def error_range(decoded: Sequence[Shown]) -> tuple[float, float]:
    """Lowest and highest error that colours stand for: what a codec's clouds have at all rates.

    But for outliers; three powers of ten at most. Both are 0 where no cloud has an error.
    """
    known = [shown.errors for shown in decoded if shown.errors is not None]
    errors = np.concatenate([np.empty(0), *known])
    if not errors.any():
        return 0.0, 0.0
    low, high = (float(np.quantile(errors[errors > 0], share)) for share in _SHARES)
    decades = min(max(log10(high / low), _LEAST_DECADES), MOST_DECADES)
    return high / 10**decades, high


def cloud_payload(shown: Shown, limits: tuple[float, float] = (0.0, 0.0)) -> dict[str, Any]:
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
        payload["error"] = b64encode(levels(shown.errors, *limits).tobytes()).decode("ascii")
        payload["quantiles"] = rounded(np.quantile(shown.errors, [0.5, 0.95]))
    return payload


def levels(errors: Floats, lowest: float, highest: float) -> Any:
    """Errors (n,) as uint8: 255 is `highest` or more, 1 is `lowest`, 0 below; logarithmic."""
    if highest == 0:
        return np.zeros(len(errors), np.uint8)
    with np.errstate(divide="ignore"):
        shares = np.log(errors / lowest) / np.log(highest / lowest)
    return np.clip(np.floor(1 + 254 * shares + 1e-9), 0, 255).astype(np.uint8)
