from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError
from pointkit.files import sha256, write_json
from pointkit.geometry.cloud import Floats
from pointkit.models import Model
from puckbench.codecs.learned import require_networks
from puckbench.codecs.registry import entry as complete_entry
from puckbench.codecs.registry import (
    module_of,
    open_codec,
    open_training,
    place_of,
    training_class,
)
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.steps.coding import CodecStep, with_options
from puckbench.steps.fingerprints import code_version
from puckbench.steps.step import STEPS, Paths, PlannedStep, planned

if TYPE_CHECKING:
    from pcc_networks.training.loop import BaseTrainer
    from pcc_networks.training.settings import BaseTraining
    from puckbench.planning.workflow import Workflow

CODE = (
    *(*CLOUD_FILES, *CODEC, "puckbench.steps.training_log", "puckbench.steps.validation"),
    "pcc_networks.training",
    *("puckbench.metrics.geometry", "puckbench.metrics.lossless", "puckbench.metrics.psnr"),
)

_BYTES_PER_POINT = 50
"""Memory of a training per point of the clouds, bytes."""


class ValidationSettings(Model):
    """Settings of the validation of a training."""

    validate_every: int = Field(
        0, ge=0, description="Steps between two validations; 0: only at the end."
    )


@STEPS.register("weights")
class Train(CodecStep, ValidationSettings):
    """Train the neural network of a learned codec.

    Parameters
    ----------
    options
        Settings of the training, such as ``steps`` and ``seed``.
    start
        Initial weights: name of shipped weights, or a file; by default random.
    every
        Number of steps between two checkpoints.
    peak
        Peak of the validation's PSNRs, in the unit of the clouds; by default from the descriptions
        of the validation's clouds.
    code
        Fingerprint of the code. If it is set, a checkpoint that was made with other code is
        deleted, and the training starts anew. Otherwise, a checkpoint of another training raises an
        error.
    """

    options: dict[str, Any] = Field({})
    start: str | None = None
    every: int = Field(100, ge=1)
    peak: float | None = Field(None, gt=0)
    code: str | None = None

    @classmethod
    def of_plan(cls, flow: Workflow, /, trained: str) -> PlannedStep:
        training, plan = flow.plan.trainings[trained], flow.plan
        module = module_of(training_class(training.codec, training.entry))
        codec = module_of(place_of(training.codec, training.entry))
        clouds, validate = (
            [flow.files.cloud(*cloud)["cloud"] for cloud in clouds]
            for clouds in (training.clouds, training.validate)
        )
        about = [str(Path(file).with_suffix(".json")) for file in (*clouds, *validate)]
        start = {"start": [] if training.start is None else [training.start]}
        is_made = plan.config.train[trained].start in plan.trainings
        made, given = (start, {}) if is_made else ({}, start)
        points = sum(plan.datasets[dataset].points for dataset, _ in training.clouds)
        return planned(
            cls(
                codec=training.codec,
                entry=training.entry,
                options=training.settings,
                start=training.start,
                validate_every=plan.config.train[trained].validate_every,
                code=code_version(module, codec, "pcc_networks.training"),
            ),
            {"clouds": clouds, "validate": validate, "about": about, **made},
            *(module, codec),
            content=given,
            also=[
                *training.clouds,
                *training.validate,
                plan.digest_of(file for files in given.values() for file in files),
            ],
            memory_mb=3000 + points * _BYTES_PER_POINT // 1_000_000,
            minutes=24 * 60,
        )

    def run(self, clouds: Paths, weights: Path, validate: Paths = ()) -> dict[str, Any]:
        """Train the network, write its weights, and return the model card.

        If there is a checkpoint beside `weights`, the training continues from it.

        Parameters
        ----------
        clouds, validate
            Files of prepared clouds for the training and for the validation.
        weights
            File to write. The model card (JSON) and the losses (CSV) are written beside it.
        """
        require_networks()
        from pcc_networks.training.loop import train
        from puckbench.steps.training_log import TrainingLog, resume

        self._check_entry()
        training = open_training(self.codec, self.entry, self.options)
        checkpoint = weights.with_suffix(".pt")
        with training.trainer() as trainer:
            self._begin(trainer, training, clouds)
            resume(trainer, checkpoint, anew=self.code is not None)
            _say(f"{training.steps} steps on cubes of {len(clouds)} prepared clouds")
            examples = training.examples([_voxels(path) for path in clouds])
            curve = TrainingLog(trainer, weights.with_suffix(".csv"), self.every)

            def report(step: int, loss: Any) -> None:
                curve.note(step, loss)
                if self.validate_every and step % self.validate_every == 0:
                    self._measure_now(training, trainer, weights, validate)

            train(trainer, examples.batch, checkpoint, self.every, report)
            curve.write()
        card = {
            "codec": self.codec,
            **training.model_dump(),
            "device": next(trainer.model.parameters()).device.type,
            "data": _names(clouds),
            **({"start": Path(self.start).stem} if self.start else {}),
            "seconds": curve.seconds,
        }
        training.export(weights, trainer.model, card)
        if validate:
            card["validation"] = self._measured(training, weights, validate)
            training.export(weights, trainer.model, card)
        write_json(weights.with_suffix(".json"), card)
        return card

    def _check_entry(self) -> None:
        """Raise InputError if an option of the codec is invalid, or its device is missing."""
        device: Any = getattr(open_codec(self.codec, self.entry).options, "device", "cpu")
        from pcc_networks.weights_file import why_not

        if reason := why_not(device):
            raise InputError(f"codec {self.codec}: {reason}")

    def _begin(
        self, trainer: BaseTrainer[Any, Any], training: BaseTraining, clouds: Sequence[Path]
    ) -> None:
        trainer.identity = {"data": [sha256(path) for path in clouds]}
        if self.code is not None:
            trainer.identity["code"] = self.code
        if self.start is not None:
            from pcc_networks.catalogue import weights_file

            start = weights_file(self.start)
            training.begin(trainer.model, start)
            trainer.identity["start"] = sha256(start)

    def _measured(
        self, training: BaseTraining, weights: Path, validate: Sequence[Path]
    ) -> dict[str, Any]:
        from puckbench.steps.validation import peak_of, validation

        clouds = [read_cloud(path) for path in validate]
        changes = with_options(self.entry, weights=str(weights))
        rates = training.rates(complete_entry(self.codec, changes)["rates"])
        codec = open_codec(self.codec, {**changes, "rates": rates})
        peak = self.peak or peak_of(clouds)
        if peak is None:
            _say("the validation's clouds tell no size, or several: no d1_psnr without --peak")
        results = validation(codec, clouds, peak)
        for fault in results["faults"]:
            _say(f"warning: {weights.stem}: {fault}")
        return {"data": _names(validate), **results}

    def _measure_now(
        self,
        training: BaseTraining,
        trainer: BaseTrainer[Any, Any],
        weights: Path,
        validate: Sequence[Path],
    ) -> None:
        now = weights.with_name(f".{weights.name}")
        training.export(now, trainer.model, {})
        for rate, means in self._measured(training, now, validate)["rates"].items():
            values = ", ".join(f"{name} {value:.4g}" for name, value in means.items())
            _say(f"step {trainer.done}, {rate}: {values}")
        now.unlink()


def _say(line: str) -> None:
    print(line, file=sys.stderr)  # noqa: T201


def _names(paths: Sequence[Path]) -> list[str]:
    shared = os.path.commonpath([path.parent.resolve() for path in paths])
    return sorted(path.resolve().relative_to(shared).as_posix() for path in paths)


def _voxels(path: Path) -> Floats:
    cloud = read_cloud(path)
    if cloud.frame == "metric":
        raise InputError(f"{path}: the cloud is in metres: prepare it first (puckbench prepare)")
    return cloud.xyz
