from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError
from puckbench.core.code import TABLES
from puckbench.steps.step import STEPS, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *TABLES,
    "puckbench.report",
    "puckbench.steps.cost",
    "puckbench.tables.rate_deltas",
)

_AFTERWARDS = {"report_page", "reference"}
"""Steps whose time does not count for the duration of a run."""


@STEPS.register("reference")
class Reference(Step):
    """Write a run's tables, configuration and machine to one file of reference results.

    Parameters
    ----------
    contents
        Contents of the run's report, as JSON (`puckbench.report.contents.Contents`).
    bd_rate
        Anchor codec and metrics of the run's Bjontegaard deltas.
    """

    contents: dict[str, Any]
    bd_rate: dict[str, Any]

    @classmethod
    def of_plan(cls, flow: Workflow, /) -> PlannedStep:
        outputs = flow.outputs
        contents = outputs.report_contents.as_json()
        deltas = {"anchor": outputs.anchor, **outputs.comparison}
        return planned(cls(contents=contents, bd_rate=deltas), outputs.reference_inputs)

    def run(
        self,
        out: Path,
        metrics: Path | None = None,
        clouds: Path | None = None,
        scan_errors: Path | None = None,
        drives: Path | None = None,
    ) -> dict[str, Any]:
        """Write the file `out`, and return facts about it.

        Times are left out if other work on the machine disturbed the measurements. The other
        arguments are files of the tables of these names. A run without clouds has only `drives`.
        """
        from pointkit.tables import read_table
        from puckbench.report.contents import Contents
        from puckbench.report.reference_results import (
            plain_rows,
            why_not_timed,
            without_times,
            write_drive_results,
            write_reference,
        )
        from puckbench.report.run_description import this_machine
        from puckbench.report.run_record import RunRecord
        from puckbench.steps.cost import read_costs

        contents = Contents.from_json(self.contents)
        costs = [] if contents.logs is None else list(read_costs(Path(contents.logs)))
        not_timed = why_not_timed(costs)
        record = RunRecord.of(cost for cost in costs if cost["job"] not in _AFTERWARDS)
        tables = {"clouds": clouds, "scan_errors": scan_errors}
        about = {
            "configuration": self.contents["configuration"],
            "style": self.contents["style"],
            "bd_rate": self.bd_rate,
            "machine": this_machine(),
            "record": record.as_json(),
            **({"not_timed": not_timed} if not_timed else {}),
            **{name: plain_rows(read_table(file)) for name, file in tables.items() if file},
        }
        source = metrics or drives
        if source is None:
            raise InputError("reference: no table of results")
        write = write_reference if metrics else write_drive_results
        table = read_table(source)
        write(out, without_times(table) if not_timed else table, about)
        return {"file": str(out), "rows": len(table), "bytes": out.stat().st_size}
