"""How well predicted classes agree with true ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit import confusion as counted
from pointkit.confusion import IGNORED, mean_iou
from pointkit.confusion import class_ious as ious

__all__ = ["IGNORED", "confusion", "ious", "mean_iou"]


def confusion(
    truth: NDArray[np.uint8], predicted: NDArray[np.uint8], classes: int
) -> NDArray[np.int64]:
    """Return how many points of each true class have each predicted class, (classes, classes).

    Points whose true class is `IGNORED` do not count.
    """
    return counted.confusion(truth, predicted, classes)[:, :classes]
