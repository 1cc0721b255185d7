"""Spacing, density and outliers of decoded clouds."""

from __future__ import annotations

from puckbench.geometry.cloud import PointCloud
from puckbench.metrics.metric_registry import METRICS


@METRICS.register("density")
def decoded_density(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
    """Spacing, density and outliers of the decoded cloud, in metres.

    See `puckbench.metrics.density.density`.
    """
    from puckbench.metrics.density import density, in_metres

    values = in_metres(density(decoded.xyz), reference.about.get("scale", 1.0))
    return {f"decoded_{name}": value for name, value in values.items()}
