from __future__ import annotations

from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.metric_registry import METRICS

CODE = ("puckbench.metrics.density",)


_COLUMNS = {
    "decoded_spacing_m": "Distance of decoded points to the nearest",
    "decoded_density_m2": "Density of decoded points",
    "decoded_duplicates": "Share of duplicates decoded",
    "decoded_outliers": "Share of outliers decoded",
}


@METRICS.register("density", columns=_COLUMNS)
def decoded_density(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
    """Return the spacing, density and outliers of a decoded cloud, in metres.

    They are the values of `puckbench.metrics.density.density`, with the prefix ``decoded_``.
    """
    from puckbench.metrics.density import density, density_in_metres

    values = density_in_metres(density(decoded.xyz), reference.about.get("scale", 1.0))
    return {f"decoded_{name}": value for name, value in values.items()}
