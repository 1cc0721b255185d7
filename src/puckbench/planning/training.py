from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from puckbench.codecs.registry import module_of, place_of, training_class
from puckbench.jobs.train import Train
from puckbench.planning.fingerprints import code_version
from puckbench.planning.plan import Plan
from puckbench.planning.planned_job import PlannedJob, planned

_BYTES_PER_POINT = 50
"""Memory of a training per point of the clouds, bytes."""


class TrainingJobs:
    """Plans the jobs that train the weights of learned codecs."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    def cloud_files(self, clouds: Iterable[tuple[str, str]]) -> list[str]:
        """Return the paths of prepared clouds, given as pairs (data set, cloud)."""
        folder = f"{self.plan.results}/clouds"
        return [f"{folder}/{dataset}/{cloud}.ply" for dataset, cloud in clouds]

    def descriptions(self, name: str) -> list[str]:
        """Return the paths of the descriptions of all clouds that a training reads."""
        training = self.plan.trainings[name]
        files = self.cloud_files((*training.clouds, *training.validate))
        return [str(Path(file).with_suffix(".json")) for file in files]

    def train(self, name: str) -> PlannedJob:
        """Plan the job of a training, given by its name in the configuration.

        If the code has changed, the job starts anew, and does not continue from a checkpoint.
        """
        training = self.plan.trainings[name]
        module = module_of(training_class(training.codec, training.entry))
        codec = module_of(place_of(training.codec, training.entry))
        record = Train(
            codec=training.codec,
            changes=training.entry,
            options=training.settings,
            start=training.start,
            validate_every=training.validate_every,
            code=code_version(module, codec, "pcc_networks.training"),
        )
        start = self.plan.digest_of(self.given_start(name))
        also = [*training.clouds, *training.validate, start]
        return planned(record, module, codec, also=also)

    def given_start(self, name: str) -> list[str]:
        """Return the path of the initial weights in a list.

        The list is empty if the training starts with random weights, or with the weights of another
        training of this run.
        """
        start = self.plan.trainings[name].start
        made = self.plan.config.train[name].start in self.plan.trainings
        return [] if start is None or made else [start]

    def memory_mb(self, name: str) -> int:
        """Return the estimated memory of a training, in MB."""
        datasets = self.plan.datasets
        points = sum(datasets[dataset].points for dataset, _ in self.plan.trainings[name].clouds)
        return 3000 + points * _BYTES_PER_POINT // 1_000_000
