"""Classification of decoded objects by PointNet, a network that was trained on ModelNet40."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.seeding import generator, random_rows
from puckbench.metrics.metric_registry import METRICS
from puckbench.metrics.task_measures import TaskMeasure
from puckbench.results.columns import HIGHER, RUN, TASK, Column

CODE = ("puckbench.metrics.pointnet", "pcc_networks.weights_file")

_SYNONYMS = {"human": "person"}
"""Classes of ModelNet40 by other names for them, in lower case; CAPOD has one of these."""
_QUARTER_TURNS = 4
_NO_CLASS = "the object's class is none of ModelNet40's"


def _columns() -> Iterator[Column]:
    for prefix, after in (("", ""), ("undecoded_", ", without coding")):
        for name, words in (
            ("right", "Objects whose class is recognised"),
            ("probability", "Probability of the true class"),
        ):
            column = f"class_{prefix}{name}_percent"
            yield Column(column, words + after, "%", HIGHER, TASK, missing=_NO_CLASS)
    words = "Objects that get the class that they get without coding"
    yield Column("class_agreement_percent", words, "%", HIGHER, TASK)
    yield Column("class_found", "Class that the network finds", group=RUN, bookkeeping=True)


_MEASURES = [
    TaskMeasure(
        name="object_class",
        title="Object classification",
        column="class_right_percent",
        undecoded="class_undecoded_right_percent",
        unit="%",
        better=HIGHER,
        margin=2.0,
    )
]


def _files(weights: str, **_: object) -> Iterable[Path]:
    return (Path(weights),)


@METRICS.register(
    "object_classification",
    columns=_columns(),
    measures=_MEASURES,
    needs=("pcc_networks", "torch"),
    files=_files,
)
class ObjectClassification:
    """Classify decoded objects by PointNet, and compare with the true class and the original's.

    The network sees `points` points, as in its training, of which there are `samples` random
    choices; their probabilities are averaged. Objects have z up, and are turned about z by
    `quarter_turns` before. If their heading is not known, the turn with which the original gives
    the most certain result is taken for all clouds of the object. The true class is the group of
    the cloud, such as CAPOD's class.

    Parameters
    ----------
    reference
        The original cloud of an object.
    weights
        File ``pretrained/exp_classifier/models/best_model.t7`` of the repository
        vinits5/learning3d, or another one of its trainings on ModelNet40.
    points
        Number of points that the network sees at once.
    samples
        Number of random choices of these points.
    quarter_turns
        Number of quarter turns, counter-clockwise, after which objects head as those of ModelNet40
        (CAPOD: 2); by default the most certain one of each object.
    """

    def __init__(
        self,
        reference: PointCloud,
        *,
        weights: str,
        points: int = 2048,
        samples: int = 3,
        quarter_turns: int | None = None,
    ) -> None:
        from puckbench.metrics.pointnet import CLASSES, read_pointnet

        if points < 1 or samples < 1:
            raise InputError("metric object_classification: points and samples must be at least 1")
        self._classes = CLASSES
        self._network = read_pointnet(Path(weights))
        self._points, self._samples = points, samples
        possible = range(_QUARTER_TURNS) if quarter_turns is None else [quarter_turns]
        views = {turns: self._probabilities(reference.xyz, turns) for turns in possible}
        self._turns = max(views, key=lambda turns: views[turns].max())
        self._undecoded = views[self._turns]
        name = str(reference.about.get("group", "")).lower()
        name = _SYNONYMS.get(name, name)
        self._truth = CLASSES.index(name) if name in CLASSES else None

    def __call__(self, decoded: PointCloud) -> dict[str, float | str]:
        """Return whether the decoded object's class is right, its probability, and the class."""
        probabilities = self._probabilities(decoded.xyz, self._turns)
        found = int(np.argmax(probabilities))
        return {
            **self._scores(probabilities),
            **self._scores(self._undecoded, "undecoded_"),
            "class_agreement_percent": 100.0 * (found == int(np.argmax(self._undecoded))),
            "class_found": self._classes[found],
        }

    def _scores(self, probabilities: Floats, prefix: str = "") -> dict[str, float]:
        if self._truth is None:
            return {}
        return {
            f"class_{prefix}right_percent": 100.0 * (int(np.argmax(probabilities)) == self._truth),
            f"class_{prefix}probability_percent": 100 * float(probabilities[self._truth]),
        }

    def _probabilities(self, points: Floats, quarter_turns: int) -> Floats:
        """Return the mean probabilities (40,) of the classes over the samples."""
        from puckbench.metrics.pointnet import in_unit_sphere, y_up

        rng = generator(0, "object_classification")
        turned = y_up(points, quarter_turns)
        samples = [
            self._network.probabilities(
                in_unit_sphere(turned[random_rows(len(points), self._points, rng)])
            )
            for _ in range(self._samples)
        ]
        return np.asarray(np.mean(samples, axis=0))
