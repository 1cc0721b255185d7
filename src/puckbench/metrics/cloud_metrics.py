"""All distortions of a decoded cloud at once, as a result row has them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from puckbench.geometry.cloud import Floats, PointCloud

if TYPE_CHECKING:
    from puckbench.metrics.geometry import DistinctPoints, Reference


def measures(
    reference: PointCloud | Reference, decoded: Floats | DistinctPoints, peak: float | None = None
) -> dict[str, float]:
    """All distortions in the reference's frame, as PSNRs and in metres.

    Of clouds in metres D1 and D2 are given in mm² as well. Errors of no more than the rounding of
    numbers are none, and the entry ``lossless`` says so (`puckbench.metrics.lossless`).

    Parameters
    ----------
    reference
        The cloud that was coded; one without normals has no distances to planes. As a `Reference`
        where several decoded clouds are measured.
    decoded : (m, 3)
        The decoded points, in the reference's frame; as `puckbench.metrics.geometry.distortion`
        takes them.
    peak
        Peak of MPEG's PSNRs, in the reference's units, which the entry ``peak`` repeats; by default
        its own. Where it is not known they are left out, as is a PSNR without error.
    """
    from puckbench.metrics.geometry import Reference, distortion
    from puckbench.metrics.lossless import without_rounding
    from puckbench.metrics.psnr import cd_psnr, mpeg_psnr
    from puckbench.metrics.units import in_metres, in_square_millimetres

    reference = Reference.of(reference)
    cloud = reference.cloud
    found = without_rounding(distortion(reference, decoded), reference.rounding)
    peak = cloud.peak if peak is None else peak
    decibels = {**(mpeg_psnr(found, peak) if peak else {}), **cd_psnr(found, reference.diameter)}
    named = {"peak": peak} if peak else {}
    lengths = in_metres(found, cloud.about.get("scale", 1.0))
    squares = in_square_millimetres(found) if cloud.frame == "metric" else {}
    return {**found, **named, **_finite(decibels), **lengths, **squares}


def picture_measures(
    reference: PointCloud, decoded: PointCloud, pixels: int, geometry: Mapping[str, float]
) -> dict[str, float]:
    """Measures of six pictures of that width, if any, and of colours where both clouds have them.

    Parameters
    ----------
    geometry
        What `measures` found, for the joint quality of geometry and colour.
    """
    found: dict[str, float] = {}
    if pixels:
        from puckbench.metrics.views import view_quality

        found |= view_quality(reference, decoded, pixels)
    if reference.colours is not None and decoded.colours is not None:
        from puckbench.metrics.colour import colour_distortion, joint_quality

        colour = colour_distortion(reference, decoded)
        found |= {**colour, "joint_quality": joint_quality(geometry, colour)}
    return _finite(found)


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if math.isfinite(value)}
