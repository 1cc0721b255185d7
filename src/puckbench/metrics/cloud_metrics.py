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
    "puckbench.metrics.density",
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
    """Return the geometric errors and PSNRs of a decoded cloud against its original.

    If rounding of coordinates explains all errors (see `puckbench.metrics.lossless`), the errors
    are set to 0.

    Parameters
    ----------
    reference
        The original cloud. Without normals, there are no point-to-plane errors and no D2.
    decoded
        Decoded points (m, 3) in the coordinate frame of the original.
    peak
        Peak of the D1 and D2 PSNRs, in units of the cloud; by default that of the cloud's `peak`.

    Returns
    -------
    dict
        Values by name of the metric: the errors of `puckbench.metrics.geometry.distortion` in units
        of the cloud, the same errors in metres (``..._m``), PSNRs in dB, and ``lossless`` (a bool).
        For clouds in metres, ``d1_mm2`` and ``d2_mm2`` are added. Infinite PSNRs are left out.
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
    """Return the PSNR and SSIM of rendered views of a decoded cloud against views of the original.

    Parameters
    ----------
    pixels
        Width and height of each view. With 0, nothing is rendered and the result is empty.

    Returns
    -------
    dict
        Finite values of `puckbench.metrics.views.view_metrics` by name.
    """
    if not pixels:
        return {}
    from puckbench.metrics.views import view_metrics

    return _finite(view_metrics(reference, decoded, pixels))


def attribute_metrics(
    reference: PointCloud, decoded: PointCloud, geometry: Mapping[str, float]
) -> dict[str, float]:
    """Return the errors of colours and reflectances, as far as both clouds have them.

    An attribute counts as lossless if both clouds have the same values in any order. If the
    positions are lossless, the values must also be equal at each point.

    Parameters
    ----------
    reference, decoded
        The original and the decoded cloud, in one coordinate frame.
    geometry
        Result of `geometry_metrics` for the same clouds.

    Returns
    -------
    dict
        Values of `colour_distortion`, `joint_quality` and `reflectance_distortion` by name; empty
        if the clouds have no common attribute.
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
