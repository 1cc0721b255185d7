"""Counts of points by true and predicted class, and scores that follow from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

Counts = NDArray[np.int64]
IGNORED = 255
"""Number in place of a true class, for points that are not judged."""


def confusion(true: NDArray[np.integer], predicted: NDArray[np.integer], classes: int) -> Counts:
    """Count points by their true and their predicted class.

    Parameters
    ----------
    true
        True class of each point, (n,); `IGNORED` for points that are not counted.
    predicted
        Predicted class of each point, (n,); -1 for points without an answer.
    classes
        Number of classes.

    Returns
    -------
    array
        Numbers of points (classes, classes + 1), by true class and predicted class; the last column
        is for points without an answer.
    """
    judged = true != IGNORED
    columns = np.where(predicted < 0, classes, predicted)[judged]
    pairs = true[judged].astype(np.int64) * (classes + 1) + columns
    counts = np.bincount(pairs, minlength=classes * (classes + 1))
    return counts.reshape(classes, classes + 1).astype(np.int64)


def class_ious(counts: Counts) -> Floats:
    """Return the intersection over union of each class, (classes,), from a confusion matrix.

    The union has the true points of the class, and the points that are predicted as it. The matrix
    is (classes, classes), or has a further column of points without an answer. Classes without true
    points have nan.
    """
    correct, true = np.diag(counts), counts.sum(axis=1)
    union = true + counts[:, : len(counts)].sum(axis=0) - correct
    ious = np.divide(correct, union, out=np.full(len(counts), np.nan), where=true > 0)
    return np.asarray(ious)


def mean_iou(counts: Counts) -> float:
    """Return the mean of `class_ious` over the classes with true points; nan if there are none."""
    ious = class_ious(counts)
    there = ious[np.isfinite(ious)]
    return float(there.mean()) if len(there) else float("nan")
