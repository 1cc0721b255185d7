"""All metrics of a decoded cloud, as a result row has them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from puckbench.geometry.cloud import Floats, PointCloud

if TYPE_CHECKING:
    from puckbench.metrics.geometry import DistinctPoints, ReferenceCloud


def geometry_metrics(
    reference: PointCloud | ReferenceCloud,
    decoded: Floats | DistinctPoints,
    peak: float | None = None,
) -> dict[str, float]:
    """Return all geometry metrics in the reference's units, as PSNRs and in metres.

    For clouds in metres D1 and D2 are also given in mm². Errors that rounding explains are set to 0
    and marked by the entry ``lossless`` (`puckbench.metrics.lossless`).

    Parameters
    ----------
    reference
        The original cloud; without normals there is no D2.
    decoded : (m, 3)
        Decoded points in the reference's frame.
    peak
        Peak of D1 and D2 PSNR in the reference's units, by default that of the cloud. PSNRs are
        left out if the peak is unknown or the error is 0.
    """
    from puckbench.metrics.geometry import ReferenceCloud, distortion
    from puckbench.metrics.lossless import without_rounding
    from puckbench.metrics.psnr import cd_psnr, mpeg_psnr
    from puckbench.metrics.units import distortion_in_metres, in_square_millimetres

    reference = ReferenceCloud.of(reference)
    cloud = reference.cloud
    distances = without_rounding(distortion(reference, decoded), reference.rounding)
    peak = cloud.peak if peak is None else peak
    decibels = {
        **(mpeg_psnr(distances, peak) if peak else {}),
        **cd_psnr(distances, reference.diameter),
    }
    peak_entry = {"peak": peak} if peak else {}
    lengths = distortion_in_metres(distances, cloud.about.get("scale", 1.0))
    squares = in_square_millimetres(distances) if cloud.frame == "metric" else {}
    return {**distances, **peak_entry, **_finite(decibels), **lengths, **squares}


def picture_metrics(
    reference: PointCloud, decoded: PointCloud, pixels: int, geometry: Mapping[str, float]
) -> dict[str, float]:
    """Return metrics of rendered views and, if both clouds have colours, of colour.

    Parameters
    ----------
    reference, decoded
        The clouds, in one frame.
    pixels
        Width of a rendered view; 0 for no views.
    geometry
        Result of `geometry_metrics`, for the joint metric of geometry and colour.
    """
    values: dict[str, float] = {}
    if pixels:
        from puckbench.metrics.views import view_metrics

        values |= view_metrics(reference, decoded, pixels)
    if reference.colours is not None and decoded.colours is not None:
        from puckbench.metrics.colour import colour_distortion, joint_quality

        colour = colour_distortion(reference, decoded)
        values |= {**colour, "joint_quality": joint_quality(geometry, colour)}
    return _finite(values)


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if math.isfinite(value)}
