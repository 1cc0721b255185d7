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
    """Return all geometry metrics of a decoded cloud: distances in units and metres, and PSNRs.

    If rounding explains all errors, they are 0, with the entry ``lossless``. The peak of the D1 and
    D2 PSNRs is in the reference's units, by default `PointCloud.peak`. D2 needs the reference's
    normals.
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
    """Return metrics of rendered views, and of colour if both clouds have colours.

    Views are `pixels` wide; with 0 there are none. `geometry` is the result of `geometry_metrics`.
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
