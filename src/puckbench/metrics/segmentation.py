"""Semantic segmentation of decoded scans, judged at every point of the original scan.

An original point is answered by the nearest decoded point, if that is within a stated distance, and
has the class that a network names for it. A point without an answer is wrong. So a codec that drops
points cannot gain by dropping those that are hard to classify.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.confusion import IGNORED, Counts, confusion, mean_iou
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.metrics.task_measures import TaskMeasure
from puckbench.results.columns import HIGHER, LOWER, RUN, TASK, Column

CODE = ("puckbench.metrics.task_measures",)

Classes = NDArray[np.uint8]
Rows = NDArray[np.int64]
WITHIN_M = 0.5
"""Distance, in m, within which a decoded point answers for an original one. The centre of a cell of
a grid of 500 mm is at most 0.43 m from the points of the cell."""
MARGIN_PERCENT = 1.0
"""Largest loss of mean IoU, in percentage points, that counts as none."""
PREFIXES = ("segmentation", "mininet")
"""Names of the metrics, and beginnings of their columns: of our network, and of 3D-MiniNet."""
WAYS = {
    "": "after coding",
    "undecoded_": "without coding",
    "decoded_": "of the decoded points alone",
    "dropped_": "of the points that coding kept, as measured",
}
"""Prefixes of columns and, in words, whose classes they judge. The last is the control: the points
that coding dropped are missing, and the others are not moved."""


def mean_iou_percent(counts: Counts) -> float:
    """Return the mean intersection over union, in %, of the classes that have true points."""
    return 100 * mean_iou(counts)


def accuracy_percent(counts: Counts) -> float:
    """Return the share of points, in %, whose predicted class is the true one."""
    return 100 * float(np.trace(counts[:, : len(counts)]) / counts.sum())


class Answers(NamedTuple):
    """Which points of a cloud answer for the points of another.

    Parameters
    ----------
    rows
        Row of the nearest point, (n,).
    near
        Whether it is near enough to answer, (n,).
    """

    rows: Rows
    near: NDArray[np.bool_]

    @classmethod
    def of(cls, points: Floats, others: Floats, within_m: float = np.inf) -> Answers:
        """Return the nearest of `others` (m, 3) to each of `points` (n, 3), both in m."""
        from pykdtree.kdtree import KDTree

        tree = KDTree(np.ascontiguousarray(others, np.float64))
        distance, rows = tree.query(np.ascontiguousarray(points, np.float64), k=1)
        return cls(rows.astype(np.int64), distance <= within_m)

    def classes(self, predicted: Classes) -> NDArray[np.int64]:
        """Return the class of each point's answer, (n,), of predicted classes (m,); -1: none."""
        return np.where(self.near, predicted[self.rows].astype(np.int64), -1)


def kept_points(original: Floats, decoded: Floats) -> Rows:
    """Return the rows of the original points that coding kept, in ascending order.

    If there are as many decoded points as original ones, or more, these are all. Otherwise, each
    decoded point stands for the original point that is nearest to it.
    """
    return _kept(len(original), Answers.of(decoded, original).rows)


def _kept(points: int, nearest: Rows) -> Rows:
    """Return the same as `kept_points`, from the nearest original point of each decoded one."""
    return np.arange(points) if len(nearest) >= points else np.unique(nearest)


Predict = Callable[[Floats, Rows], Classes]
"""A network: the classes (m,) of points (m, 3), m, with the rows (m,) of the original points from
which it may take what is measured besides positions."""


@dataclass(frozen=True)
class JudgedScan:
    """A labelled scan whose decoded forms are judged by a network.

    Parameters
    ----------
    original
        Points (n, 3) of the scan, m.
    true
        Their classes, (n,); `IGNORED` for points that are not judged.
    names
        Names of the classes.
    predict
        The network.
    within_m
        Largest distance, in m, of a decoded point that answers for an original one.
    """

    original: Floats
    true: Classes
    names: tuple[str, ...]
    predict: Predict
    within_m: float

    @cached_property
    def _classes(self) -> Classes:
        """The classes (n,) that the network names for the scan that was not coded."""
        return self.predict(self.original, np.arange(len(self.original)))

    def undecoded(self) -> Counts:
        """Return the confusion matrix of the scan that was not coded."""
        return self._counts(self.true, self._classes.astype(np.int64))

    def decoded(self, points: Floats) -> Iterator[tuple[str, Counts]]:
        """Yield the confusion matrices of decoded points (m, 3), by prefix of their columns."""
        nearest = Answers.of(points, self.original).rows
        predicted = self.predict(points, nearest)
        answers = Answers.of(self.original, points, self.within_m)
        yield "", self._counts(self.true, answers.classes(predicted))
        yield "decoded_", self._counts(self.true[nearest], predicted.astype(np.int64))
        kept = _kept(len(self.original), nearest)
        if len(kept) == len(self.original):
            yield "dropped_", self.undecoded()
            return
        unmoved = self.predict(self.original[kept], kept)
        answers = Answers.of(self.original, self.original[kept], self.within_m)
        yield "dropped_", self._counts(self.true, answers.classes(unmoved))

    def _counts(self, true: Classes, predicted: NDArray[np.int64]) -> Counts:
        return confusion(true, predicted, len(self.names))


class SegmentationMetric:
    """A segmentation of the clouds that are decoded from one labelled scan, by some network.

    Parameters
    ----------
    prefix
        Beginning of the names of columns.
    scan
        The labelled scan.
    network
        Name and digest of the network, for the rows of results.

    Raises
    ------
    InputError
        No point of the scan has a class that is judged.
    """

    def __init__(self, prefix: str, scan: JudgedScan, network: str) -> None:
        if (scan.true == IGNORED).all():
            raise InputError("segmentation: no point of the scan has a class of the network")
        self._prefix, self._scan = prefix, scan
        self._same: dict[str, Any] = {
            **self._columns("undecoded_", scan.undecoded()),
            f"{prefix}_classes": ", ".join(scan.names),
            f"{prefix}_network": network,
            f"{prefix}_within_m": scan.within_m,
        }

    def __call__(self, decoded: PointCloud) -> dict[str, Any]:
        """Return the results of a decoded cloud by name of the column (`segmentation_columns`)."""
        values = dict(self._same)
        for way, counts in self._scan.decoded(decoded.xyz):
            values |= self._columns(way, counts)
            if not way:
                share = float(counts[:, -1].sum() / counts.sum())
                values[f"{self._prefix}_unanswered_percent"] = 100 * share
        return values

    def _columns(self, way: str, counts: Counts) -> dict[str, Any]:
        begin = f"{self._prefix}_{way}"
        return {
            f"{begin}miou_percent": mean_iou_percent(counts),
            f"{begin}accuracy_percent": accuracy_percent(counts),
            f"{begin}confusion": json.dumps(counts.tolist(), separators=(",", ":")),
        }


def confusion_of(text: str) -> Counts:
    """Return the confusion matrix (classes, classes + 1) in a column of results."""
    return np.array(json.loads(text), np.int64)


def segmentation_columns(prefix: str, network: str) -> Iterator[Column]:
    """Yield the columns of a segmentation.

    Parameters
    ----------
    prefix
        Beginning of the names of columns.
    network
        The network in words, with which descriptions end.
    """
    missing = "the scan has no labels"
    for way, whose in WAYS.items():
        words = f"{whose}, {network}"
        begin = f"{prefix}_{way}"
        first = not way
        yield Column(
            f"{begin}miou_percent", f"Mean IoU {words}", "%", HIGHER, TASK, missing=missing
        )
        text = f"Accuracy {words}"
        yield Column(f"{begin}accuracy_percent", text, "%", HIGHER, TASK, missing=missing)
        text = f"Points by true and predicted class, {words}"
        yield Column(f"{begin}confusion", text, group=TASK, missing=missing, bookkeeping=True)
        if first:
            text = f"Points without an answer, {network}"
            yield Column(f"{prefix}_unanswered_percent", text, "%", LOWER, TASK, missing=missing)
    how = partial(Column, group=RUN, missing=missing, bookkeeping=True)
    yield how(f"{prefix}_classes", f"Classes, {network}")
    yield how(f"{prefix}_network", f"Weights, {network}")
    yield how(f"{prefix}_within_m", f"Distance of answers, {network}", "m")


def segmentation_measure(prefix: str, title: str) -> Sequence[TaskMeasure]:
    """Return by what a segmentation is judged: mean IoU over the original points."""
    return [
        TaskMeasure(
            name=prefix,
            title=title,
            column=f"{prefix}_miou_percent",
            undecoded=f"{prefix}_undecoded_miou_percent",
            unit="%",
            better=HIGHER,
            margin=MARGIN_PERCENT,
        )
    ]
