from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, FigureStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

    from puckbench.geometry.rendering import Image, View

CODE = ("puckbench.geometry.rendering",)

_figure = partial(FIGURES.register, category="Clouds")
_AZIMUTH_DEG, _ELEVATION_DEG = -60.0, 38.0
_CUT_HEIGHT = 0.8
_WALL_M = 0.25
_NARROWEST, _WIDEST = 0.9, 3.0
_COVER = 10.0
_DARKEST = 0.12


@_figure("sampled_object", title="Example cloud of the object set")
def draw_object(example_object: PointCloud, style: FigureStyle) -> Figure:
    """An object, as input to codecs, in metres.

    The colour shows the height above the lowest point, and the brightness shows the orientation of
    the surface. The projection is orthographic; the bar shows the scale.
    """
    return _draw({"": _in_metres(example_object)}, style)


@_figure("raw_room", title="Example cloud of a raw room")
def draw_raw_room(example_raw: PointCloud, style: FigureStyle) -> Figure:
    """A raw room, as input to codecs, in metres.

    The upper fifth and the two near walls are left out, to show the inside. The colour shows the
    height above the lowest point, and the brightness shows the orientation of the surface. The
    projection is orthographic; the bar shows the scale.
    """
    return _draw({"": _opened(_in_metres(example_raw))}, style)


@_figure("room_scans", title="One room: raw, scanned without noise, scanned with noise")
def draw_room_versions(
    example_raw: PointCloud,
    example_clean: PointCloud,
    example_noisy: PointCloud,
    style: FigureStyle,
) -> Figure:
    """One room (a) raw, (b) scanned without noise and (c) scanned with noise, in metres.

    The upper fifth and the two near walls are left out, to show the inside. The colour shows the
    height above the lowest point. White areas in (b) and (c) are hidden from the sensor.
    """
    versions = {
        "(a) Raw": example_raw,
        "(b) Scan without noise": example_clean,
        "(c) Scan with noise": example_noisy,
    }
    return _draw({title: _opened(_in_metres(cloud)) for title, cloud in versions.items()}, style)


@dataclass(frozen=True)
class _Frame:
    view: View
    aspect: float
    floor: float
    top: float


def _in_metres(cloud: PointCloud) -> PointCloud:
    return replace(cloud, xyz=cloud.to_metres(cloud.xyz))


def _opened(room: PointCloud) -> PointCloud:
    low, high = np.quantile(room.xyz, [0.001, 0.999], axis=0)
    x, y, z = room.xyz.T
    below = z < low[2] + _CUT_HEIGHT * (high[2] - low[2])
    inside = below & (x < high[0] - _WALL_M) & (y > low[1] + _WALL_M)
    return room.select(inside) if inside.any() else room


def _draw(clouds: Mapping[str, PointCloud], style: FigureStyle) -> Figure:
    from matplotlib.figure import Figure

    width = style.width_in or (COLUMN_WIDTH_IN if len(clouds) == 1 else PAGE_WIDTH_IN)
    frame = _frame([cloud.xyz for cloud in clouds.values()])
    unit = "m" if all("scale" in cloud.about for cloud in clouds.values()) else "units"
    panel_in = (width - 0.75) / len(clouds)
    titled_in = 0.22 if any(clouds) else 0.05
    figure = Figure(figsize=(width, 1.08 * panel_in / frame.aspect + titled_in))
    panels = figure.subplots(1, len(clouds), squeeze=False)[0]
    pixels = round(panel_in * style.dpi), round(panel_in / frame.aspect * style.dpi)
    for axes, (title, cloud) in zip(panels, clouds.items(), strict=True):
        _show(axes, _picture(cloud, frame, pixels), frame, unit)
        axes.set_title(title, pad=3)
    _add_height_bar(figure, list(panels), frame, unit)
    return figure


def _frame(clouds: list[Floats]) -> _Frame:
    from puckbench.geometry.rendering import View

    ends = [np.quantile(points, [0.0005, 0.9995], axis=0) for points in clouds]
    low, high = np.min([e[0] for e in ends], axis=0), np.max([e[1] for e in ends], axis=0)
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
    azimuth, elevation = np.radians([_AZIMUTH_DEG, _ELEVATION_DEG])
    around = np.array([np.cos(azimuth), np.sin(azimuth)]) * np.cos(elevation)
    eye = centre + 2 * size * np.array([*around, np.sin(elevation)])
    right, up, _ = View(eye, centre, size).axes()
    across, upward = 1.05 * (np.abs(np.stack([right, up])) @ (high - low))
    upward = max(upward, across / _WIDEST, 0.02 * size)
    aspect = max(across / upward, _NARROWEST)
    view = View(eye, centre, float(upward))
    return _Frame(view, float(aspect), float(low[2]), float(high[2]))


def _picture(cloud: PointCloud, frame: _Frame, pixels: tuple[int, int]) -> Image:
    from puckbench.geometry.rendering import render_cloud

    span = max(frame.top - frame.floor, 1e-9)
    shares = np.clip((cloud.xyz[:, 2] - frame.floor) / span, 0, 1)
    colours = 255 * _colour_map()(shares)[:, :3]
    colours = (colours * _light(cloud, frame.view)[:, None] + 0.5).astype(np.uint8)
    disc = _COVER * pixels[0] * pixels[1] / len(cloud)
    radius = round(min(max(math.sqrt(disc / math.pi), 1), 4))
    return render_cloud(cloud.xyz, colours, frame.view, pixels, radius=radius)


def _colour_map() -> Colormap:
    import matplotlib
    from matplotlib.colors import ListedColormap

    # Shading is invisible in the darkest part.
    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(_DARKEST, 1, 256)))


def _light(cloud: PointCloud, view: View) -> Floats:
    if cloud.normals is None:
        return np.ones(len(cloud))
    right, up, forward = view.axes()
    towards = 0.5 * right + 0.7 * up - forward
    return np.asarray(0.55 + 0.45 * np.abs(cloud.normals @ towards / np.linalg.norm(towards)))


def _show(axes: Axes, picture: Image, frame: _Frame, unit: str) -> None:
    height, width, _ = picture.shape
    axes.imshow(picture, interpolation="none")
    axes.set_axis_off()
    per_pixel = (frame.view.height or 1.0) / height
    length = round_length(0.25 * width * per_pixel)
    below, end = 1.03 * height, length / per_pixel
    axes.plot([0, end], [below, below], color="black", linewidth=1.5, solid_capstyle="butt")
    axes.text(end + 0.02 * width, below, f"{length:g} {unit}", va="center")
    axes.set_xlim(0, width)
    axes.set_ylim(1.07 * height, 0)


def round_length(length: float) -> float:
    """Return the largest number up to `length` that is 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(length))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length))


def _add_height_bar(figure: Figure, panels: list[Axes], frame: _Frame, unit: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    heights = ScalarMappable(Normalize(0, frame.top - frame.floor), _colour_map())
    bar = figure.colorbar(heights, ax=panels, shrink=0.8, aspect=25, pad=0.02)
    bar.set_label(f"Height ({unit})")
    bar.outline.set_linewidth(0.4)
