"""The leaderboard: reference results as pages, and as a table of who is best at what.

``python -m puckbench.report.leaderboard FOLDER`` writes a page for each study that comes with
puckbench, as `make docs` does.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from puckbench.core.files import write_bytes
from puckbench.io.tables import write_table
from puckbench.metrics.table_registry import table_entry
from puckbench.metrics.tables.rate_deltas import bd_rate, bd_rate_clouds
from puckbench.report.build import build_page
from puckbench.report.contents import Contents
from puckbench.report.findings import Findings, findings
from puckbench.report.reference_results import ReferenceResults, read_reference, shipped

if TYPE_CHECKING:
    import pandas as pd


def study_findings(reference: ReferenceResults) -> Findings:
    """Which codec needs the fewest bits, lies nearest to the truth and is fastest in a study."""
    errors = reference.table("scan_errors")
    return findings(reference.metrics, _deltas(reference), errors, reference.style)


def write_study(reference: ReferenceResults, folder: Path) -> Path:
    """Write a study's page, with the tables that it links to.

    Parameters
    ----------
    reference
        The study's results.
    folder
        Where ``index.html`` and the folder ``tables`` go; ``tables/metrics.csv`` has all rows.

    Returns
    -------
    Path
        The page.
    """
    tables = folder / "tables"
    summary = table_entry("summary").make(metrics=reference.metrics)
    found = {
        "summary": summary,
        "bd_rate": _deltas(reference),
        "bd_rate_clouds": _clouds_deltas(reference),
    }
    found |= {name: reference.table(name) for name in ("clouds", "scan_errors")}
    written = {name: table for name, table in found.items() if table is not None}
    for name, table in written.items():
        write_table(table, tables / f"{name}.csv")
    write_table(reference.metrics, tables / "metrics.csv")
    contents = Contents(
        title=f"Reference results: {reference.title}",
        metrics=str(tables / "metrics.csv"),
        tables={name: str(tables / f"{name}.csv") for name in written},
        configuration=reference.about["configuration"],
        style=tuple(reference.about["style"]),
    )
    page = folder / "index.html"
    remarks = {"Times": f"not timed: {reference.not_timed}"} if reference.not_timed else {}
    text = build_page(contents, reference.about["machine"], folder, reference.record, remarks)
    write_bytes(page, text.encode())
    return page


def _deltas(reference: ReferenceResults) -> pd.DataFrame | None:
    """Bjontegaard deltas of the study's codecs; None where it has one alone."""
    if reference.metrics["codec"].nunique() < 2:
        return None
    return bd_rate(reference.metrics, **reference.bd_rate)


def _clouds_deltas(reference: ReferenceResults) -> pd.DataFrame | None:
    if reference.metrics["codec"].nunique() < 2:
        return None
    options = {name: reference.bd_rate[name] for name in ("anchor", "qualities")}
    return bd_rate_clouds(reference.metrics, **options)


if __name__ == "__main__":
    for study in shipped():
        write_study(read_reference(study), Path(sys.argv[1]) / study)
