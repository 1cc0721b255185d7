"""Picture of the codec `primitives`: a scan, its primitives, the decoded cloud, the errors.

(a) and (d) have the colour of the distance to the true surface. The upper fifth and the two near
walls are left out of the drawing, but not of the largest distances.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.geometry.mesh import Mesh
from pointkit.seeding import generator
from primitive_codec.decoder import read_patches
from primitive_codec.mesh_reconstruction import segment_points
from puckbench.codecs.registry import open_codec
from puckbench.figures.style import PAGE_WIDTH_IN
from puckbench.geometry.closest import closest_surface_points
from puckbench.geometry.rendering import View, render_cloud

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

_PIXELS = (1100, 760)
_LEAST_MM = 1.0
_MAP = "viridis"
_WALL_M, _TOP = 0.25, 0.8


def opened(points: Floats, low: Floats, high: Floats) -> Any:
    """Which points (n, 3) lie neither in the upper fifth nor in the two near walls of a box."""
    x, y, z = points.T
    below = z < low[2] + _TOP * (high[2] - low[2])
    return below & (x < high[0] - _WALL_M) & (y > low[1] + _WALL_M)


def distances_mm(points: Floats, truth: Mesh) -> Floats:
    distances_m = np.linalg.norm(points - closest_surface_points(truth, points).xyz, axis=1)
    return np.asarray(1000 * distances_m)


def by_primitive(names: Any) -> Any:
    """Colours (n, 3), one for each primitive, none too dark or too light."""
    return (generator(3, "palette").random((names.max() + 1, 3)) * 170 + 60).astype("u1")[names]


def draw_primitives(cloud: PointCloud, truth: Mesh, rate: str = "r4") -> Figure:
    """Draw a scaled cloud, coded at a rate, and the distances to its true surface, in metres."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    stream = open_codec("primitives").encode(cloud, rate)
    patches = read_patches(stream)
    planes, rounds = int(patches.octree.leaves.counts[1]), len(patches.revolutions)
    decoded, names = segment_points(patches)
    scan, decoded = cloud.to_metres(cloud.xyz), cloud.to_metres(decoded)
    low, high = np.quantile(scan, [0.001, 0.999], axis=0)
    errors = [distances_mm(points, truth) for points in (scan, decoded)]
    most = [float(values.max()) for values in errors]
    parts = [opened(points, low, high) for points in (scan, decoded)]
    scan, decoded, names = scan[parts[0]], decoded[parts[1]], names[parts[1]]
    scale = ScalarMappable(LogNorm(_LEAST_MM, max(*most, 10.0)), _MAP)
    by_error = [
        scale.to_rgba(values[part], bytes=True)[:, :3]
        for values, part in zip(errors, parts, strict=True)
    ]
    top = np.array([*high[:2], low[2] + _TOP * (high[2] - low[2])])
    centre, size = (low + top) / 2, float(np.linalg.norm(top - low))
    view = View(centre + 2 * size * np.array([0.4, -0.7, 0.6]), centre, size)
    drawn = {
        f"(a) The scan: at most {most[0]:.0f} mm from the truth": (scan, by_error[0]),
        f"(b) The stream: {planes} planes, {rounds} round surfaces": (decoded, by_primitive(names)),
        f"(c) The decoded cloud, {8 * len(stream) / len(cloud):.2f} bits per point": (
            decoded,
            None,
        ),
        f"(d) Decoded: at most {most[1]:.0f} mm from the truth": (decoded, by_error[1]),
    }
    shown = {
        title: render_cloud(xyz, colours, view, _PIXELS, radius=3)
        for title, (xyz, colours) in drawn.items()
    }
    return _figure(_cropped(shown), scale)


def _cropped(shown: dict[str, Any]) -> dict[str, Any]:
    """The part of the pictures outside of which all are white."""
    drawn = np.any([(picture < 255).any(axis=2) for picture in shown.values()], axis=0)
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return {title: picture[part] for title, picture in shown.items()}


def _figure(shown: dict[str, Any], scale: ScalarMappable) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_WIDTH_IN, 5.2))
    panels = figure.subplots(2, 2).ravel()
    for axes, (title, picture) in zip(panels, shown.items(), strict=True):
        axes.imshow(picture, interpolation="none")
        axes.set_axis_off()
        axes.set_title(title, pad=3)
    bar = figure.colorbar(scale, ax=list(panels), shrink=0.6, aspect=25, pad=0.02, extend="min")
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.set_label("(a), (d): distance to the true surface (mm)")
    return figure
