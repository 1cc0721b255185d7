from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.confusion import class_ious
from pointkit.errors import InputError
from puckbench.metrics.segmentation import (
    PREFIXES,
    WAYS,
    accuracy_percent,
    confusion_of,
    mean_iou_percent,
)
from puckbench.tables.registry import SEGMENTATION, TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.metrics.segmentation",)

_WORDS = {"": "coded", "undecoded_": "without coding", "decoded_": "decoded", "dropped_": "holes"}


@TABLES.register(
    "segmentation_scores",
    title="Segmentation over all scans",
    needs=(SEGMENTATION,),
    columns={
        "judged": "Points that are judged",
        "miou_percent": "Mean IoU over all scans",
        "accuracy_percent": "Accuracy over all scans",
        "iou_percent": "IoU of each class over all scans",
    },
    shown=("dataset", "task", "codec", "rate", "judged", "bpp", "miou_percent"),
)
def segmentation_scores(metrics: pd.DataFrame) -> pd.DataFrame:
    """The table shows segmentation of decoded scans with the points of all scans counted together.

    So rare classes count by all their points, and not by the scans in which they are. ``judged``
    tells which points are judged: ``coded``, every original point by the decoded point that answers
    for it; ``decoded``, the decoded points alone; ``holes``, the control in which the points that
    coding dropped are missing, but the others are as measured; ``without coding``, the scan itself.
    ``iou_percent`` lists the intersection over union of each class.
    """
    import pandas as pd

    rows = [row for prefix in PREFIXES for row in _of_network(metrics, prefix)]
    if not rows:
        raise InputError("metrics table: no results of a segmentation")
    return pd.DataFrame(rows)


def _of_network(metrics: pd.DataFrame, prefix: str) -> Iterator[dict[str, Any]]:
    if f"{prefix}_confusion" not in metrics:
        return
    judged = metrics[metrics[f"{prefix}_confusion"].notna()]
    keys = ["dataset", "codec", "rate"]
    for key, group in judged.groupby(keys, sort=False):
        names = str(group[f"{prefix}_classes"].iloc[0]).split(", ")
        for way in WAYS:
            matrices = [confusion_of(text) for text in group[f"{prefix}_{way}confusion"]]
            counts = np.sum(matrices, axis=0)
            ious = zip(names, class_ious(counts), strict=True)
            yield {
                **dict(zip(keys, key, strict=True)),
                "task": prefix,
                "judged": _WORDS[way],
                "clouds": len(group),
                "bpp": float(group["bpp"].mean()),
                "miou_percent": mean_iou_percent(counts),
                "accuracy_percent": accuracy_percent(counts),
                "iou_percent": ", ".join(
                    f"{name} {100 * iou:.1f}" for name, iou in ious if not math.isnan(iou)
                ),
            }
