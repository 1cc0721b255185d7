"""How well predicted classes agree with true ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_segmentation.class_maps import IGNORED


def confusion(
    truth: NDArray[np.uint8], predicted: NDArray[np.uint8], classes: int
) -> NDArray[np.int64]:
    """Return how many points of each true class have each predicted class, (classes, classes).

    Points whose true class is `IGNORED` do not count.
    """
    judged = truth != IGNORED
    pairs = truth[judged].astype(np.int64) * classes + predicted[judged]
    return np.bincount(pairs, minlength=classes**2).reshape(classes, classes)


def ious(matrix: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the intersection over union of each class, (classes,), from a confusion matrix.

    It is NaN for classes without true points.
    """
    both, there = np.diag(matrix), matrix.sum(axis=1)
    union = there + matrix.sum(axis=0) - both
    return np.asarray(np.divide(both, union, out=np.full(len(both), np.nan), where=there > 0))


def mean_iou(matrix: NDArray[np.int64]) -> float:
    """Return the mean of `ious` over the classes that have true points; NaN if there are none."""
    values = ious(matrix)
    there = values[np.isfinite(values)]
    return float(there.mean()) if len(there) else float("nan")
