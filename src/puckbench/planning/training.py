"""Jobs that train weights of learned codecs."""

from __future__ import annotations

from collections.abc import Iterable

from puckbench.codecs.registry import module_of, training_class
from puckbench.jobs.train import Train
from puckbench.planning.fingerprints import code_version
from puckbench.planning.plan import Plan, TrainingPlan
from puckbench.planning.planned_job import PlannedJob, planned

_BYTES_PER_POINT = 50
"""Of a training, which keeps nothing of a point but its coordinates."""


class TrainingJobs:
    """Files and jobs of the trainings."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    def training(self, name: str) -> TrainingPlan:
        """The plan of a training."""
        return self.plan.trainings[name]

    def cloud_files(self, clouds: Iterable[tuple[str, str]]) -> list[str]:
        """Prepared clouds of (data set, cloud)."""
        folder = f"{self.plan.results}/clouds"
        return [f"{folder}/{dataset}/{cloud}.ply" for dataset, cloud in clouds]

    def train(self, name: str) -> PlannedJob:
        """Train weights; a checkpoint that other code made is begun anew."""
        chosen = self.training(name)
        record = Train(
            codec=chosen.codec,
            changes=chosen.entry,
            options=chosen.settings,
            start=chosen.start,
            validate_every=chosen.validate_every,
            code=code_version(module_of(training_class(chosen.codec, chosen.entry))),
        )
        return planned(record)

    def memory_mb(self, name: str) -> int:
        """Estimate of a training's memory in MB: the network's, and that of all clouds at once."""
        datasets = self.plan.datasets
        points = sum(datasets[dataset].points for dataset, _ in self.training(name).clouds)
        return 3000 + points * _BYTES_PER_POINT // 1_000_000
