from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from cloud_files.clouds import read_cloud
from pointkit.files import write_json
from puckbench.steps.coding import Decoded
from puckbench.steps.evaluate import Measuring, Originals
from puckbench.steps.step import STEPS, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = ("puckbench.steps.evaluate",)


@STEPS.register("scan_error")
class ScanError(Step):
    """Measure the errors of a scan before any coding, as if it were a decoded cloud.

    `dataset` is the name of the data set, for the row of results.
    """

    dataset: str

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str) -> PlannedStep:
        files = flow.files
        truth = files.truth(dataset, cloud)
        return planned(
            cls(dataset=dataset),
            {**files.cloud(dataset, cloud), **files.described(truth)},
            also=" ".join(truth),
            memory_mb=files.memory_mb(dataset),
            minutes=30,
        )

    def run(
        self,
        cloud: Path,
        row: Path,
        truth: Path | None = None,
        visible: Path | None = None,
        clean: Path | None = None,
    ) -> dict[str, Any]:
        """Compare a cloud with its truth, write the row of results (JSON), and return it.

        `truth`, `visible` and `clean` are the files of `puckbench.steps.evaluate.Originals`.
        """
        measuring, originals = (
            Measuring(dataset=self.dataset),
            Originals(cloud, truth, visible, clean),
        )
        result = measuring.row(originals, Decoded(read_cloud(cloud), {}))
        write_json(row, result)
        return result
