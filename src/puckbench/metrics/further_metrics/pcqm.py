from __future__ import annotations

from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.metric_registry import METRICS
from puckbench.results.columns import LOWER, SEEN, Column

CODE = ("puckbench.metrics.pcqm", "puckbench.metrics.paired_values")

_MISSING = "no colours were coded, or fewer than 20 points"


@METRICS.register(
    "pcqm", columns=[Column("pcqm", "PCQM", better=LOWER, group=SEEN, missing=_MISSING)]
)
def visual_error(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
    """Return PCQM, the error of the look of a coloured cloud (`puckbench.metrics.pcqm`).

    The result is empty if a cloud has no colours or fewer than 20 distinct points.
    """
    from puckbench.metrics.pcqm import pcqm

    clouds = (reference, decoded)
    if any(cloud.colours is None or _is_small(cloud) for cloud in clouds):
        return {}
    return {"pcqm": pcqm(reference, decoded)}


def _is_small(cloud: PointCloud) -> bool:
    import numpy as np

    from puckbench.metrics.pcqm import NEIGHBOURS

    return len(cloud) < NEIGHBOURS or len(np.unique(cloud.xyz, axis=0)) < NEIGHBOURS
