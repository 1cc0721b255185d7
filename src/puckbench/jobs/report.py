from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pointkit.files import write_bytes
from puckbench.core.code import CLOUD_FILES, TABLES
from puckbench.jobs.registry import JOBS, Job

CODE = (
    *CLOUD_FILES,
    *TABLES,
    "puckbench.report",
    "puckbench.jobs.cost",
    "puckbench.tables.uses",
)


@JOBS.register("report")
class Report(Job):
    """Build the report page of a run.

    Parameters
    ----------
    contents
        What the report shows, as JSON (`puckbench.report.contents.Contents`).
    code
        Places (``module:Name`` or ``file.py:Name``) of the user's figures and tables, which this
        job may import.
    """

    contents: dict[str, Any]
    code: tuple[str, ...] = ()

    def plugins(self) -> Iterable[str | None]:
        return self.code

    def run(self, page: Path, below: Path | None = None) -> dict[str, Any]:
        """Write the file `page` (HTML), and return its path and size in bytes.

        The page is made of the run's files or, if `below` is set, of copies of them in this folder.
        """
        from puckbench.jobs.cost import read_costs
        from puckbench.report.build import build_page
        from puckbench.report.contents import Contents
        from puckbench.report.run_description import this_machine
        from puckbench.report.run_record import RunRecord

        contents = Contents.from_json(self.contents)
        if below is not None:
            contents = contents.under(below)
        costs = [] if contents.logs is None else read_costs(Path(contents.logs))
        record = RunRecord.of(cost for cost in costs if cost["job"] != JOBS.name_of(type(self)))
        data = build_page(contents, this_machine(), page.parent, record).encode()
        write_bytes(page, data)
        return {"page": str(page), "bytes": len(data)}
