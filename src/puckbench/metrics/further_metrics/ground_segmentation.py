"""Ground segmentation of decoded clouds by Patchwork++.

References
----------
S. Lee, H. Lim and H. Myung, "Patchwork++: Fast and Robust Ground Segmentation Solving Partial
Under-Segmentation Using 3D Point Cloud", IROS 2022.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.metrics.metric_registry import METRICS
from puckbench.metrics.segmentation import Answers
from puckbench.metrics.task_measures import TaskMeasure
from puckbench.results.columns import HIGHER, LOWER, RUN, TASK, Column

CODE = ("puckbench.geometry.labels", "puckbench.metrics.segmentation")

GROUND = frozenset(
    {
        *("floor", "ground", "kerb", "lane-marking", "other-ground", "parking", "pavement"),
        *("road", "sidewalk", "terrain"),
    }
)
"""Names of the classes that are ground, in virtual scenes and in SemanticKITTI."""
_UNJUDGED = frozenset({"outlier", "unlabeled"})
"""Names of the classes whose points are not judged. In SemanticKITTI, neither is vegetation, which
is grass as well as trees: so do Patchwork++'s authors."""
_SECTORS, _NEAR_M, _LOWEST = 36, 20.0, 0.05
"""Sectors around the sensor, largest distance of their points, and the share of lowest points from
which the height of the sensor is estimated."""
_USUAL_HEIGHT_M = 1.723
"""Height that Patchwork++ assumes, for clouds without a point near the sensor."""
_LEAST_HEIGHT_M = 0.1
_NO_LABELS = "the points have no classes"
_SCALED = "the cloud is not in metres"

Flags = NDArray[np.bool_]


def _columns() -> Iterator[Column]:
    for prefix, after in (("", ""), ("undecoded_", ", without coding")):
        for name, words in (
            ("iou", "Intersection over union of the ground"),
            ("accuracy", "Points whose class, ground or not, is right"),
        ):
            column = f"ground_{prefix}{name}_percent"
            yield Column(column, words + after, "%", HIGHER, TASK, missing=_NO_LABELS)
        column = f"ground_{prefix}agreement_percent"
        words = "Points that are ground, or not, as without coding"
        is_line = bool(prefix)
        yield Column(column, words + after, "%", HIGHER, TASK, missing=_SCALED, bookkeeping=is_line)
    text = "Points for which no decoded point answers"
    yield Column("ground_unanswered_percent", text, "%", LOWER, TASK, missing=_SCALED)
    text = "Distance within which a decoded point answers"
    yield Column("ground_reach_m", text, "m", group=RUN)
    yield Column("ground_height_m", "Height of the sensor above the ground", "m", group=RUN)


_MEASURES = [
    TaskMeasure(
        name=name,
        title=title,
        column=f"ground_{value}_percent",
        undecoded=f"ground_undecoded_{value}_percent",
        unit="%",
        better=HIGHER,
        margin=1.0,
    )
    for name, title, value in (
        ("ground", "Ground segmentation", "iou"),
        ("ground_agreement", "Ground segmentation, agreement", "agreement"),
    )
]


@METRICS.register(
    "ground_segmentation", columns=_columns(), measures=_MEASURES, needs=("pypatchworkpp",)
)
class GroundSegmentation:
    """Segment the ground of decoded clouds of a sensor, and judge every point of the original.

    Patchwork++ decides of each decoded point whether it is ground. The nearest decoded point within
    `reach_m` answers for a point of the original cloud; without any, the point counts as wrong. The
    answers are compared with the labels of the original, if it has classes, and with the result of
    Patchwork++ on the original. Both clouds get the same settings, which are the authors' defaults;
    intensities are not used.

    Parameters
    ----------
    reference
        The original cloud, in metres with z up.
    reach_m
        Largest distance, in m, of a decoded point that answers for an original one.
    height_m
        Height, in m, of the sensor above the ground; by default it is estimated from the lowest
        points around the sensor.
    max_range_m
        Largest horizontal distance, in m, of points that can be ground.
    """

    def __init__(
        self,
        reference: PointCloud,
        *,
        reach_m: float = 0.3,
        height_m: float | None = None,
        max_range_m: float = 80.0,
    ) -> None:
        if reach_m <= 0 or max_range_m <= 0:
            raise InputError("metric ground_segmentation: reach_m and max_range_m must be above 0")
        self._is_scaled = reference.frame == "scaled"
        if self._is_scaled:
            return
        self._sensor = sensor_position(reference)
        self._points = reference.xyz - self._sensor
        self._reach_m, self._max_range_m = reach_m, max_range_m
        self._height_m = sensor_height(self._points) if height_m is None else height_m
        self._is_ground = ground_points(self._points, self._height_m, max_range_m)
        self._truth = ground_truth(reference)
        everywhere = np.ones(len(reference), np.bool_)
        self._undecoded = self._scores(self._is_ground, everywhere, "undecoded_")

    def __call__(self, decoded: PointCloud) -> dict[str, float]:
        """Return the scores of a decoded cloud, and those of the original (``..._undecoded_...``).

        They are empty for scaled clouds.
        """
        if self._is_scaled:
            return {}
        points = decoded.xyz - self._sensor
        is_ground = ground_points(points, self._height_m, self._max_range_m)
        nearest, is_answered = Answers.of(self._points, points, self._reach_m)
        return {
            **self._scores(is_ground[nearest] & is_answered, is_answered),
            "ground_unanswered_percent": 100 * float(np.mean(~is_answered)),
            **self._undecoded,
            "ground_reach_m": self._reach_m,
            "ground_height_m": self._height_m,
        }

    def _scores(self, answer: Flags, is_answered: Flags, prefix: str = "") -> dict[str, float]:
        agrees = is_answered & (answer == self._is_ground)
        scores = {"agreement": float(agrees.mean())}
        if self._truth is not None:
            is_judged, is_ground = self._truth
            answer, is_answered, is_ground = (
                each[is_judged] for each in (answer & is_answered, is_answered, is_ground)
            )
            scores["accuracy"] = float(np.mean(is_answered & (answer == is_ground)))
            if (union := np.count_nonzero(answer | is_ground)) > 0:
                scores["iou"] = float(np.count_nonzero(answer & is_ground) / union)
        return {f"ground_{prefix}{name}_percent": 100 * value for name, value in scores.items()}


def ground_points(points: Floats, height_m: float, max_range_m: float = 80.0) -> Flags:
    """Return which points are ground according to Patchwork++.

    Parameters
    ----------
    points
        Points (n, 3) in m, with z up and the sensor at the origin.
    height_m
        Height of the sensor above the ground, in m.
    max_range_m
        Largest horizontal distance of points that can be ground, in m.

    Returns
    -------
    numpy.ndarray
        True for ground, (n,).
    """
    from pypatchworkpp import Parameters, patchworkpp

    settings = Parameters()
    settings.sensor_height, settings.max_range = height_m, max_range_m
    settings.enable_RNR = False  # it needs intensities
    settings.verbose = False
    with _without_output():  # it greets
        program = patchworkpp(settings)
    program.estimateGround(points.astype(np.float32))
    is_ground = np.zeros(len(points), np.bool_)
    is_ground[program.getGroundIndices()] = True
    return is_ground


@contextmanager
def _without_output() -> Iterator[None]:
    """Discard what compiled code prints, which would stand among a command's answer."""
    sys.stdout.flush()
    output, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(output, 1)
        os.close(output)
        os.close(nowhere)


def sensor_height(points: Floats) -> float:
    """Estimate the height of a sensor at the origin above the ground, in m, from points (n, 3).

    In each of 36 sectors, the lowest 5 % of the points within 20 m are taken for ground. The result
    is the median over the sectors, and at least 0.1 m; without such points, 1.723 m.
    """
    points = points[np.linalg.norm(points[:, :2], axis=1) <= _NEAR_M]
    angle = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) + 0.5
    sector = np.minimum((angle * _SECTORS).astype(int), _SECTORS - 1)
    lowest = [np.quantile(points[sector == each, 2], _LOWEST) for each in np.unique(sector)]
    return max(-float(np.median(lowest)), _LEAST_HEIGHT_M) if lowest else _USUAL_HEIGHT_M


def sensor_position(cloud: PointCloud) -> Floats:
    """Return the position (3,) of the sensor in a cloud in metres; it is 0 if it is not known."""
    offset = np.asarray(cloud.about.get("offset", (0.0, 0.0, 0.0)), np.float64)
    return np.asarray(cloud.about.get("origin", offset), np.float64) - offset


def ground_truth(cloud: PointCloud) -> tuple[Flags, Flags] | None:
    """Return which points (n,) are judged, and which are ground; None if they have no classes."""
    from puckbench.geometry.labels import SEMANTIC_KITTI, class_labels

    if cloud.labels is None or "classes" not in cloud.about:
        return None
    numbers, names, label_set = class_labels(cloud)
    lower = [name.lower() for name in names]
    unjudged = _UNJUDGED | ({"vegetation"} if label_set == SEMANTIC_KITTI else set())
    is_judged = np.array([name not in unjudged for name in lower] + [False])
    is_ground = np.array([name in GROUND for name in lower] + [False])
    places = np.where(numbers < 0, len(names), numbers)
    return is_judged[places], is_ground[places]
