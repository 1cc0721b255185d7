"""Picture of the codec `primitives`: a scan, its primitives, the decoded cloud, the errors.

    python -m benchmarks.primitives_picture OUT.png [--results results]
        [--cloud rooms_noisy/office_1] [--scene rooms/office_1] [--rate r4]

Cloud and scene are of a run's results, those of the default run where none are named. Above stand
the cloud and the primitives in one colour each, below the decoded cloud, plain and with its errors:
(a) and (d) have the colour of the distance to the true surface. The upper fifth and the two near
walls are left out. Prints bits per point and how many planes and round surfaces the stream has.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.codecs.registry import open_codec
from puckbench.core.seeding import generator
from puckbench.figures.drawing import lay_out, save_figure
from puckbench.figures.style import PAGE_WIDTH_IN, FigureStyle
from puckbench.geometry.closest import closest_surface_points
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.mesh import Mesh
from puckbench.geometry.rendering import View, render_cloud
from puckbench.io.clouds import read_cloud
from puckbench.io.meshes.reading import read_mesh
from puckbench.primitives.decoder import read_patches
from puckbench.primitives.segmentation import segment_points

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PIXELS = (1100, 760)
_FAR_MM = 30.0
_MAP = "viridis"
_WALL_M, _TOP = 0.25, 0.8


def opened(points: Floats, low: Floats, high: Floats) -> Any:
    """Which points (n, 3) lie neither in the upper fifth nor in the two near walls of a box."""
    x, y, z = points.T
    below = z < low[2] + _TOP * (high[2] - low[2])
    return below & (x < high[0] - _WALL_M) & (y > low[1] + _WALL_M)


def by_error(points: Floats, truth: Mesh) -> Any:
    import matplotlib

    distance_m = np.linalg.norm(points - closest_surface_points(truth, points).xyz, axis=1)
    return _bytes(matplotlib.colormaps[_MAP](1000 * distance_m / _FAR_MM)[:, :3])


def by_primitive(names: Any) -> Any:
    """Colours (n, 3), one for each primitive, none too dark or too light."""
    return (generator(3, "palette").random((names.max() + 1, 3)) * 170 + 60).astype("u1")[names]


def _bytes(colours: Floats) -> Any:
    return (255 * colours + 0.5).astype("u1")


def pictures(cloud: PointCloud, truth: Mesh, decoded: Floats, names: Any) -> dict[str, Any]:
    low, high = np.quantile(cloud.xyz, [0.001, 0.999], axis=0)
    kept = opened(decoded, low, high)
    scan, decoded, names = cloud.xyz[opened(cloud.xyz, low, high)], decoded[kept], names[kept]
    top = np.array([*high[:2], low[2] + _TOP * (high[2] - low[2])])
    centre, size = (low + top) / 2, float(np.linalg.norm(top - low))
    view = View(centre + 2 * size * np.array([0.4, -0.7, 0.6]), centre, size)
    drawn = {
        "(a) The scan, by its distance to the truth": (scan, by_error(scan, truth)),
        "(b) Primitives of the stream, one colour each": (decoded, by_primitive(names)),
        "(c) The decoded cloud": (decoded, None),
        "(d) The decoded cloud, by its distance to the truth": (decoded, by_error(decoded, truth)),
    }
    return _cropped(
        {
            title: render_cloud(xyz, colours, view, _PIXELS, radius=3)
            for title, (xyz, colours) in drawn.items()
        }
    )


def _cropped(shown: dict[str, Any]) -> dict[str, Any]:
    """The part of the pictures outside of which all are white."""
    drawn = np.any([(picture < 255).any(axis=2) for picture in shown.values()], axis=0)
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return {title: picture[part] for title, picture in shown.items()}


def draw(shown: dict[str, Any]) -> Figure:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_WIDTH_IN, 5.2))
    panels = figure.subplots(2, 2).ravel()
    for axes, (title, picture) in zip(panels, shown.items(), strict=True):
        axes.imshow(picture, interpolation="none")
        axes.set_axis_off()
        axes.set_title(title, pad=3)
    errors = ScalarMappable(Normalize(0, _FAR_MM), _MAP)
    bar = figure.colorbar(errors, ax=list(panels), shrink=0.6, aspect=25, pad=0.02, extend="max")
    bar.set_label("(a), (d): distance to the true surface (mm)")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--cloud", default="rooms_noisy/office_1")
    parser.add_argument("--scene", default="rooms/office_1")
    parser.add_argument("--rate", default="r4")
    options = parser.parse_args()
    cloud = read_cloud(options.results / "clouds" / f"{options.cloud}.ply")
    truth = read_mesh(options.results / "scenes" / f"{options.scene}.ply")
    stream = open_codec("primitives").encode(cloud.xyz, options.rate)
    patches = read_patches(stream)
    planes, rounds = int(patches.octree.leaves.counts[1]), len(patches.revolutions)
    print(f"{8 * len(stream) / len(cloud):.4f} bpp, {planes} planes, {rounds} round surfaces")
    decoded, names = segment_points(patches)
    scan = replace(cloud, xyz=cloud.to_metres(cloud.xyz))
    style = FigureStyle(dpi=200)
    with style.context():
        figure = draw(pictures(scan, truth, cloud.to_metres(decoded), names))
        lay_out(figure)
        save_figure(figure, options.out)
    _quantize(options.out)


def _quantize(path: Path) -> None:
    from PIL import Image

    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    small.save(path, optimize=True)


if __name__ == "__main__":
    main()
