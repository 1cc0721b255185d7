from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError, naming
from pointkit.files import sha256, write_json
from pointkit.models import parsed
from puckbench.core.code import CLOUD_FILES
from puckbench.geometry.labels import OF_SCENE, class_labels
from puckbench.steps.fingerprints import code_version
from puckbench.steps.step import STEPS, Paths, PlannedStep, Step, planned

if TYPE_CHECKING:
    from lidar_segmentation import LabelledScan, SegmentationTraining
    from puckbench.planning.workflow import Workflow

CODE = (
    *(*CLOUD_FILES, "puckbench.geometry.labels"),
    *("puckbench.steps.segmentation_trainer", "puckbench.steps.training_log"),
)
_LEARNED = ("lidar_segmentation.*", "pcc_networks.training")

_BYTES_PER_POINT = 40
"""Memory of a training per point of the clouds, bytes."""
_DIGITS = 4


def open_segmentation_training(settings: Mapping[str, Any]) -> SegmentationTraining:
    """Return the checked settings of a training; raise InputError if one is invalid."""
    for package in ("lidar_segmentation", "pcc_networks"):
        if find_spec(package) is None:
            raise InputError(f"{package} not installed: pip install 'puckbench[learned]'")
    from lidar_segmentation import SegmentationTraining, class_map

    training = parsed(SegmentationTraining, settings, "training")
    class_map(training.labels)
    return training


@STEPS.register("segmentation_weights")
class TrainSegmentation(Step):
    """Train a network of segmentation on labelled clouds, and measure it on others.

    Parameters
    ----------
    options
        Settings of the training, such as ``steps`` and ``seed``.
    every
        Number of steps between two checkpoints.
    code
        Fingerprint of the code. A checkpoint that was made with other code is deleted, and the
        training starts anew.
    """

    options: dict[str, Any] = Field({})
    every: int = Field(100, ge=1)
    code: str | None = None

    @classmethod
    def of_plan(cls, flow: Workflow, /, network: str) -> PlannedStep:
        plan = flow.plan
        training = plan.segmentations[network]
        clouds, validate = (
            [flow.files.cloud(*cloud)["cloud"] for cloud in clouds]
            for clouds in (training.clouds, training.validate)
        )
        about = [str(Path(file).with_suffix(".json")) for file in (*clouds, *validate)]
        points = sum(plan.datasets[dataset].points for dataset, _ in training.clouds)
        return planned(
            cls(options=training.settings, code=code_version(__name__, *_LEARNED)),
            {"clouds": clouds, "validate": validate, "about": about},
            *_LEARNED,
            also=[*training.clouds, *training.validate],
            memory_mb=2000 + points * _BYTES_PER_POINT // 1_000_000,
            minutes=24 * 60,
        )

    def run(self, clouds: Paths, weights: Path, validate: Paths = ()) -> dict[str, Any]:
        """Train the network, write its weights, and return the model card.

        If there is a checkpoint beside `weights`, the training continues from it.

        Parameters
        ----------
        clouds, validate
            Files of labelled clouds in the sensor's frame, in metres, for the training and for the
            validation.
        weights
            File to write. The model card (JSON) and the losses (CSV) are written beside it.
        """
        training = open_segmentation_training(self.options)
        from pcc_networks.training.loop import train
        from puckbench.steps.segmentation_trainer import segmentation_trainer
        from puckbench.steps.training_log import TrainingLog, resume

        examples = training.examples([read_labelled(path, training.labels) for path in clouds])
        trainer = segmentation_trainer(training, examples)
        checkpoint = weights.with_suffix(".pt")
        trainer.identity = {"data": [sha256(path) for path in clouds], "code": self.code or ""}
        resume(trainer, checkpoint, anew=self.code is not None)
        print(f"{training.steps} steps on {len(clouds)} clouds", file=sys.stderr)  # noqa: T201
        curve = TrainingLog(trainer, weights.with_suffix(".csv"), self.every)
        train(trainer, examples.batch, checkpoint, self.every, curve.note)
        curve.write()
        card = {
            **training.model_dump(mode="json"),
            "data": _by_data_set(clouds),
            "seconds": curve.seconds,
        }
        training.export(weights, trainer.model, card)
        if validate:
            card["validation"] = validation(weights, validate, training.labels)
            training.export(weights, trainer.model, card)
        write_json(weights.with_suffix(".json"), card)
        return card


def read_labelled(path: Path, labels: str) -> LabelledScan:
    """Read a labelled cloud as a scan with the class of each point.

    Parameters
    ----------
    path
        A cloud in the sensor's frame, in metres. Its description names the classes (``classes``)
        and the set of labels (``label_set``).
    labels
        Label set of the training, which has the classes of virtual scenes (``scene``).

    Raises
    ------
    InputError
        The cloud has no labels, or a class that the label set lacks.
    """
    from lidar_segmentation import IGNORED, LabelledScan, class_map

    with naming(path):
        cloud = read_cloud(path)
        found = class_labels(cloud)
        mapping = class_map(labels if found.label_set == OF_SCENE else found.label_set)
        classes = np.append(mapping.of(found.names), np.uint8(IGNORED))  # -1 is the last
    return LabelledScan(
        cloud.xyz.astype(np.float32), classes[np.maximum(found.numbers, -1)], mapping.joins
    )


def validation(weights: Path, clouds: Sequence[Path], labels: str) -> dict[str, Any]:
    """Measure a network on labelled clouds.

    Parameters
    ----------
    weights
        File of weights.
    clouds
        Files of labelled clouds, of several data sets, each in a folder.
    labels
        Label set of the network's training.

    Returns
    -------
    dict
        For each data set, ``accuracy`` (share of the judged points whose class is right), ``iou``
        (intersection over union of each class that has points, of all clouds together), ``miou``
        (their mean), and ``miou_of_clouds``, the same of each cloud.
    """
    from lidar_segmentation import confusion, ious, mean_iou, open_network

    network = open_network(weights)
    results = {}
    for dataset, paths in _grouped(clouds).items():
        matrices = {}
        for path in paths:
            scan = read_labelled(path, labels)
            predicted = scan.joined(network.predict(scan.xyz))
            matrices[path.stem] = confusion(scan.classes, predicted, len(network.classes))
        total = sum(matrices.values(), np.zeros((), np.int64))
        values = zip(network.classes, ious(total).tolist(), strict=True)
        results[dataset] = {
            "accuracy": round(float(total.trace() / total.sum()), _DIGITS),
            "miou": round(mean_iou(total), _DIGITS),
            "iou": {name: round(value, _DIGITS) for name, value in values if not isnan(value)},
            "miou_of_clouds": {
                name: round(mean_iou(matrix), _DIGITS) for name, matrix in matrices.items()
            },
        }
    return results


def _grouped(paths: Sequence[Path]) -> dict[str, list[Path]]:
    groups: dict[str, list[Path]] = {}
    for path in paths:
        groups.setdefault(path.parent.name, []).append(path)
    return groups


def _by_data_set(paths: Sequence[Path]) -> dict[str, list[str]]:
    return {name: [path.stem for path in files] for name, files in _grouped(paths).items()}
