"""Metrics of rendered images of a cloud: six views along the axes, as in PCC Arena."""

from __future__ import annotations

import math

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud, check_points
from puckbench.geometry.rendering import Image, View, render_cloud
from puckbench.metrics.psnr import psnr
from puckbench.metrics.ssim import WINDOW, ssim

PIXELS = 1920
"""Width and height of images in PCC Arena."""
_FAR = 200.0
"""Grey value at the far side of the bounding box of a cloud without colours; the near side is 0,
the background 255."""
_AXES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_LUMA = np.array([0.2126, 0.7152, 0.0722])


def view_metrics(
    reference: PointCloud, decoded: PointCloud, pixels: int = PIXELS, radius: int | None = None
) -> dict[str, float]:
    """Compare six rendered views of a decoded cloud with those of the original.

    Views show luma (BT.709) if both clouds have colours, else the depth from the near side of the
    original's bounding box. The background counts too, so only values for the same cloud are
    comparable.

    Parameters
    ----------
    reference, decoded
        The original and the decoded cloud, in one coordinate frame.
    pixels
        Width and height of each view.
    radius
        Radius in pixels of the disc that is drawn for a point; by default `closing_radius`.

    Returns
    -------
    dict
        ``view_psnr``, the PSNR in dB of all views; ``view_ssim``, their mean structural similarity;
        ``view_pixels`` and ``view_radius``, the settings.

    Raises
    ------
    InputError
        The decoded cloud is empty, or the views are smaller than SSIM's window.
    """
    check_points(decoded.xyz, "decoded cloud")
    if pixels < WINDOW:
        raise InputError(f"views: {pixels} pixels are too few; SSIM needs {WINDOW} or more")
    if radius is None:
        radius = closing_radius(reference.xyz, pixels)
    coloured = reference.colours is not None and decoded.colours is not None
    squared, structure = 0.0, 0.0
    bounds = np.stack([reference.xyz.min(axis=0), reference.xyz.max(axis=0)])
    for axis in range(len(_AXES)):
        a, b = (
            view(cloud, axis, bounds, pixels, radius, coloured).astype(np.float64)
            for cloud in (reference, decoded)
        )
        squared += float(np.mean((a - b) ** 2)) / len(_AXES)
        structure += ssim(a, b) / len(_AXES)
    values = {"view_psnr": psnr(squared, 255.0), "view_ssim": structure}
    return values | {"view_pixels": pixels, "view_radius": radius}


def view(
    cloud: PointCloud, axis: int, bounds: Floats, pixels: int, radius: int, coloured: bool
) -> Image:
    """Render a grey image (pixels, pixels) of a cloud along a coordinate axis.

    Parameters
    ----------
    axis
        Direction from which the cloud is seen: 0 to 5 for +x, -x, +y, -y, +z and -z.
    bounds
        Lowest and highest corner (2, 3) of a box. Its longest side fills the image, except for
        margins of 2 %.
    pixels
        Width and height of the image.
    radius
        Radius of the disc of a point, in pixels.
    coloured
        Whether the image shows the luma of the points' colours; otherwise it shows their depth.
    """
    direction = np.array(_AXES[axis], dtype=np.float64)
    centre, extent = bounds.mean(axis=0), float(np.ptp(bounds, axis=0).max()) or 1.0
    # Points that a codec moved out of the box are still before the camera.
    eye = centre + direction * (2 * extent)
    up = (0.0, 1.0, 0.0) if direction[2] else (0.0, 0.0, 1.0)
    camera = View(eye, centre, extent * 1.04, up)
    greys = _luminance(cloud) if coloured else _depth_grey(cloud.xyz, direction, bounds)
    colours = np.repeat(greys[:, None], 3, axis=1)
    size = (pixels, pixels)
    return render_cloud(cloud.xyz, colours, camera, size, radius=radius, shade=False)[..., 0]


def closing_radius(points: Floats, pixels: int) -> int:
    """Return the disc radius in pixels with which rendered points (n, 3) leave few gaps.

    The radius is twice the median distance to the nearest neighbour, and at least 1.
    """
    from puckbench.metrics.density import density

    spacing = density(points).get("spacing_median", 0.0)
    extent = float(np.ptp(points, axis=0).max()) or 1.0
    return max(1, math.ceil(2 * spacing * pixels / (1.04 * extent)))


def _depth_grey(points: Floats, direction: Floats, bounds: Floats) -> Image:
    along = bounds @ direction
    near, depth = along.max(), float(np.ptp(along)) or 1.0
    share = np.clip((near - points @ direction) / depth, 0, 1)
    return np.asarray(np.round(_FAR * share), dtype=np.uint8)


def _luminance(cloud: PointCloud) -> Image:
    return np.asarray(np.round(np.asarray(cloud.colours) @ _LUMA), dtype=np.uint8)
