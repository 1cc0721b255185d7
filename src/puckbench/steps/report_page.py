from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.files import write_bytes
from puckbench.core.code import CLOUD_FILES, TABLES
from puckbench.figures.registry import FigureEntry, figure_entries
from puckbench.report.page import assets_version
from puckbench.report.sections import SECTIONS, sections_of
from puckbench.steps.step import STEPS, PlannedStep, Step, planned
from puckbench.tables.registry import TableEntry, table_entries

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *CLOUD_FILES,
    *TABLES,
    "puckbench.report",
    "puckbench.core.renamed_keys",
    "puckbench.steps.cost",
    "puckbench.tables.uses",
)


@STEPS.register("report_page")
class Report(Step):
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

    @classmethod
    def of_plan(cls, flow: Workflow, /) -> PlannedStep:
        contents = flow.outputs.report_contents
        entries: Iterator[FigureEntry | TableEntry] = chain(
            figure_entries().values(), table_entries().values()
        )
        texts = "".join(f"{entry.number} {entry.title} {entry.caption}" for entry in entries)
        digest = hashlib.sha256(texts.encode()).hexdigest()[:16]
        return planned(
            cls(
                contents=contents.as_json(),
                code=(*contents.own_figures, *contents.own_tables),
            ),
            {"files": contents.files()},
            *(SECTIONS.module_of(section.name) for section in sections_of(contents.tables)),
            also=f"{assets_version()} {flow.outputs.codec_styles} {digest}",
            memory_mb=2000,
            minutes=20,
        )

    def plugins(self) -> Iterable[str | None]:
        return self.code

    def run(self, page: Path, below: Path | None = None) -> dict[str, Any]:
        """Write the file `page` (HTML), and return its path and size in bytes.

        The page is made of the run's files or, if `below` is set, of copies of them in this folder.
        """
        from puckbench.report.build import build_page
        from puckbench.report.contents import Contents
        from puckbench.report.run_description import this_machine
        from puckbench.report.run_record import RunRecord
        from puckbench.steps.cost import read_costs

        contents = Contents.from_json(self.contents)
        if below is not None:
            contents = contents.under(below)
        costs = [] if contents.logs is None else read_costs(Path(contents.logs))
        record = RunRecord.of(cost for cost in costs if cost["job"] != STEPS.name_of(type(self)))
        data = build_page(contents, this_machine(), page.parent, record).encode()
        write_bytes(page, data)
        return {"page": str(page), "bytes": len(data)}
