from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import log10
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from cloud_files.clouds import read_cloud
from pointkit.errors import naming
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.seeding import generator
from puckbench.core.archives import SUFFIX, read_member
from puckbench.figures.style import FigureStyle
from puckbench.report.contents import Contents, Example
from puckbench.report.plot_data import codec_payload, round_significant

if TYPE_CHECKING:
    import pandas as pd

BYTES_PER_POINT = 28 / 3
"""Size of a decoded point in the page: three coordinates of two bytes each and an error of one
byte, in base64.
"""
MOST_DECADES = 3
"""Largest range of the colour scale of errors, in powers of ten."""
_MOST_POINTS, _MOST_MB = 20_000, 8.0
"""Largest number of points of a cloud, and largest size, in MB, of all clouds in the page."""
_LEAST_DECADES = 0.3
_STEPS = 65535
_LEAST_POINTS = 100
_SHARES = (0.02, 0.999)
"""Quantiles of a codec's errors that become the ends of the colour scale."""
_COLOUR_STOPS = 64
_COLOUR_MAPS = {"height": ("viridis", 0.2), "error": ("inferno", 0.25)}
"""Colour maps, and the fraction at which each starts; darker colours would be invisible on the
page.
"""


def viewer_payload(
    contents: Contents,
    metrics: pd.DataFrame | None,
    scan_errors: pd.DataFrame | None,
    style: FigureStyle,
) -> dict[str, Any]:
    """Return the data of the page's viewer of clouds, as a JSON object.

    Parameters
    ----------
    contents
        Contents of the page, with the files of the example clouds.
    metrics, scan_errors
        Results of the run, and errors of the scans before coding; None if the run has none.
    style
        Style of the figures.
    """
    clouds = sum(1 + sum(map(len, e.decoded.values())) for e in contents.examples)
    points = points_per_cloud(_MOST_POINTS, clouds, _MOST_MB)
    codecs = style.ordered_codecs(c for example in contents.examples for c in example.decoded)
    return {
        "codecs": [codec_payload(name, style) for name in codecs],
        "maps": {name: _colours(*which) for name, which in _COLOUR_MAPS.items()},
        "examples": [_example(item, points, metrics, style) for item in contents.examples],
        "start": initial_view(contents.examples, metrics, scan_errors),
    }


def initial_view(
    examples: Sequence[Example], metrics: pd.DataFrame | None, scan_errors: pd.DataFrame | None
) -> dict[str, Any]:
    """Choose the decoded cloud that the viewer shows first.

    It is the one whose distance to the true surface, relative to that of the scan before coding, is
    smallest. Without true surfaces, the last example is shown.

    Returns
    -------
    dict
        Number of the ``example``, from 0, and, with a true surface, ``codec`` and ``rate``.
    """
    gains: dict[tuple[int, str, str], float] = {}
    for number, example in enumerate(examples):
        names = {"dataset": example.dataset, "cloud": example.cloud}
        scan = _value(scan_errors, "truth_cd_plane", **names)
        for codec, files in example.decoded.items():
            for rate in files if scan else ():
                keys = {**names, "codec": codec, "rate": rate}
                distance = _value(metrics, "truth_cd_plane", **keys)
                if scan and distance is not None:
                    gains[number, codec, rate] = distance / scan
    if not gains:
        return {"example": len(examples) - 1}
    number, codec, rate = min(gains, key=lambda view: gains[view])
    return {"example": number, "codec": codec, "rate": rate}


def _value(table: pd.DataFrame | None, column: str, **keys: str) -> float | None:
    if table is None or column not in table:
        return None
    rows = table[np.all([table[name] == value for name, value in keys.items()], axis=0)]
    values = rows[column].dropna()
    return float(values.iloc[0]) if len(values) else None


def _example(
    example: Example, points: int, metrics: pd.DataFrame | None, style: FigureStyle
) -> dict[str, Any]:
    original = read_cloud(Path(example.original))
    coded = (
        (codec, rate, _decoded(Path(file), rate).xyz)
        for codec, files in example.decoded.items()
        for rate, file in files.items()
    )
    decoded = decoded_for_viewer(original, coded, points)
    payload = example_payload(
        original_for_viewer(original, points), decoded, "scale" in original.about
    )
    for item in payload["decoded"]:
        item["bpp"] = _bpp(metrics, example, item["codec"], item["rate"])
    return {
        "title": f"{style.title(example.dataset)}: {example.cloud}",
        "opened": example.kind != "object",
        **payload,
    }


def _decoded(file: Path, rate: str) -> PointCloud:
    if file.suffix != SUFFIX:
        return read_cloud(file)
    with TemporaryDirectory() as folder, naming(file):
        path = Path(folder, "cloud.ply")
        path.write_bytes(read_member(file, f"{rate}.ply"))
        return read_cloud(path)


def _bpp(metrics: pd.DataFrame | None, example: Example, codec: str, rate: str) -> float | None:
    names = {"dataset": example.dataset, "cloud": example.cloud, "codec": codec, "rate": rate}
    value = _value(metrics, "bpp", **names)
    return None if value is None else float(f"{value:.4g}")


def _colours(name: str, start: float) -> list[str]:
    import matplotlib
    from matplotlib.colors import to_hex

    shares = (start + (1 - start) * step / (_COLOUR_STOPS - 1) for step in range(_COLOUR_STOPS))
    return [to_hex(matplotlib.colormaps[name](share)) for share in shares]


@dataclass(frozen=True)
class ViewerCloud:
    """A cloud in the viewer, reduced to a sample of its points.

    Parameters
    ----------
    xyz
        Points of the sample, (n, 3), in m.
    total
        Number of points of the whole cloud.
    errors
        Distances of the points from the nearest original point, (n,), in m; None for an original
        cloud.
    """

    xyz: Floats
    total: int
    errors: Floats | None = None


def points_per_cloud(most: int, clouds: int, most_mb: float) -> int:
    """Return how many points of each cloud fit into the page.

    Parameters
    ----------
    most
        Largest number of points of a cloud.
    clouds
        Number of clouds.
    most_mb
        Largest size of all clouds, in MB.
    """
    fitting = most_mb * 1e6 / (max(clouds, 1) * BYTES_PER_POINT)
    return max(_LEAST_POINTS, min(most, int(fitting)))


def subsample_points(points: Floats, most: int, *names: str) -> Floats:
    """Return a random sample of at most `most` points (n, 3).

    The sample is reproducible, because `names` determine the seed.
    """
    if len(points) <= most:
        return points
    rows = generator(0, "report", *names).choice(len(points), most, replace=False)
    return points[np.sort(rows)]


def original_for_viewer(original: PointCloud, most: int) -> ViewerCloud:
    """Return a sample of at most `most` points of an original cloud."""
    return ViewerCloud(
        original.to_metres(subsample_points(original.xyz, most, "original")), len(original)
    )


def decoded_for_viewer(
    original: PointCloud, decoded: Iterable[tuple[str, str, Floats]], most: int
) -> list[tuple[str, str, ViewerCloud]]:
    """Return samples of decoded clouds, with the error of each point.

    Parameters
    ----------
    original
        The cloud before coding.
    decoded
        Codec, rate, and points (m, 3) in the original's coordinate frame, of each decoded cloud.
    most
        Largest number of points of a sample.

    Returns
    -------
    list
        Codec, rate and cloud for each decoded cloud.
    """
    from pykdtree.kdtree import KDTree

    tree = KDTree(original.xyz)
    scale = float(original.about.get("scale", 1.0))
    clouds = []
    for codec, rate, points in decoded:
        sample = subsample_points(points, most, codec, rate)
        errors = tree.query(np.ascontiguousarray(sample))[0] / scale
        cloud = ViewerCloud(original.to_metres(sample), len(points), errors)
        clouds.append((codec, rate, cloud))
    return clouds


def example_payload(
    original: ViewerCloud, decoded: Sequence[tuple[str, str, ViewerCloud]], in_metres: bool
) -> dict[str, Any]:
    """Return an original cloud and its decoded versions as a JSON object."""
    ranges = {name: error_range([s for c, _, s in decoded if c == name]) for name, _, _ in decoded}
    return {
        "unit": "m" if in_metres else "grid units",
        "ranges": {name: round_significant(limits) for name, limits in ranges.items()},
        "original": cloud_payload(original),
        "decoded": [
            {"codec": codec, "rate": rate, **cloud_payload(shown, ranges[codec])}
            for codec, rate, shown in decoded
        ],
    }


def error_range(decoded: Sequence[ViewerCloud]) -> tuple[float, float]:
    """Return the errors at the lower and the upper end of a codec's colour scale.

    The scale leaves out extreme errors, and spans at most three decades.
    """
    error_arrays = [shown.errors for shown in decoded if shown.errors is not None]
    errors = np.concatenate([np.empty(0), *error_arrays])
    if not errors.any():
        return 0.0, 0.0
    low, high = (float(np.quantile(errors[errors > 0], share)) for share in _SHARES)
    decades = min(max(log10(high / low), _LEAST_DECADES), MOST_DECADES)
    return high / 10**decades, high


def cloud_payload(shown: ViewerCloud, limits: tuple[float, float] = (0.0, 0.0)) -> dict[str, Any]:
    """Return a cloud as a JSON object.

    Parameters
    ----------
    shown
        The cloud.
    limits
        Ends of the colour scale of errors.

    Returns
    -------
    dict
        ``xyz`` has the coordinates as 16-bit integers, in 65,535 steps of the bounding box, in
        base64. For decoded clouds, ``error`` has errors quantised by `levels`, in base64.
    """
    low, high = shown.xyz.min(axis=0), shown.xyz.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    steps = np.rint((shown.xyz - low) * (_STEPS / extent)).astype("<u2")
    payload: dict[str, Any] = {
        "points": len(shown.xyz),
        "total": shown.total,
        "low": round_significant(low, 7),
        "extent": round_significant(extent, 7),
        "xyz": b64encode(steps.tobytes()).decode("ascii"),
    }
    if shown.errors is not None:
        payload["error"] = b64encode(levels(shown.errors, *limits).tobytes()).decode("ascii")
        payload["quantiles"] = round_significant(np.quantile(shown.errors, [0.5, 0.95]))
    return payload


def levels(errors: Floats, lowest: float, highest: float) -> Any:
    """Quantise errors logarithmically to 8 bits, as places on the colour scale.

    Parameters
    ----------
    errors
        Errors, (n,).
    lowest, highest
        Errors at the ends of the colour scale.

    Returns
    -------
    numpy.ndarray
        Levels, (n,): 0 below `lowest`, 255 from `highest` on.
    """
    if highest == 0:
        return np.zeros(len(errors), np.uint8)
    with np.errstate(divide="ignore"):
        shares = np.log(errors / lowest) / np.log(highest / lowest)
    return np.clip(np.floor(1 + 254 * shares + 1e-9), 0, 255).astype(np.uint8)
