from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.geometry.attributes import COLOUR, REFLECTANCE, attributes_of

if TYPE_CHECKING:
    from puckbench.metrics.geometry import DistinctPoints, ReferenceCloud

CODE = (
    "puckbench.geometry.attributes",
    "puckbench.geometry.rendering",
    "puckbench.metrics.colour",
    "puckbench.metrics.geometry",
    "puckbench.metrics.lossless",
    "puckbench.metrics.paired_values",
    "puckbench.metrics.psnr",
    "puckbench.metrics.reflectance",
    "puckbench.metrics.sensor_metrics",
    "puckbench.metrics.ssim",
    "puckbench.metrics.units",
    "puckbench.metrics.views",
)


def geometry_metrics(
    reference: PointCloud | ReferenceCloud,
    decoded: Floats | DistinctPoints,
    peak: float | None = None,
) -> dict[str, float]:
    """Return distances, in the cloud's units and in metres, and PSNRs of a decoded cloud.

    If rounding explains all errors, they are set to 0, and the entry ``lossless`` is true. The peak
    of the D1 and D2 PSNRs, in units, is by default `PointCloud.peak`. D2 needs the reference's
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


def picture_metrics(reference: PointCloud, decoded: PointCloud, pixels: int) -> dict[str, float]:
    """Return metrics of rendered views, `pixels` wide and high; none if `pixels` is 0."""
    if not pixels:
        return {}
    from puckbench.metrics.views import view_metrics

    return _finite(view_metrics(reference, decoded, pixels))


def attribute_metrics(
    reference: PointCloud, decoded: PointCloud, geometry: Mapping[str, float]
) -> dict[str, float]:
    """Return metrics of colours and reflectances that both clouds have.

    `geometry` comes from `geometry_metrics`. An attribute is lossless if both clouds have equal
    values in any order and, if positions are lossless, at each point.
    """
    values: dict[str, float] = {}
    pairs = attributes_of(reference), attributes_of(decoded)
    if all(COLOUR in attributes for attributes in pairs):
        from puckbench.metrics.colour import colour_distortion, joint_quality

        colour = colour_distortion(reference, decoded)
        values |= {**colour, "joint_quality": joint_quality(geometry, colour)}
    if all(REFLECTANCE in attributes for attributes in pairs):
        from puckbench.metrics.reflectance import reflectance_distortion

        a, b = (attributes[REFLECTANCE] for attributes in pairs)
        values |= reflectance_distortion((reference.xyz, a), (decoded.xyz, b))
    for name in (COLOUR, REFLECTANCE):
        if geometry.get("lossless") and values.get(f"{name}_max_error"):
            values[f"{name}_lossless"] = False
    return _finite(values)


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if math.isfinite(value)}
