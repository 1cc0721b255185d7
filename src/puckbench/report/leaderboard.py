"""The leaderboard: a page with findings for each study with reference results.

``python -m puckbench.report.leaderboard FOLDER`` writes the pages of all studies that come with
puckbench.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pointkit.files import write_bytes
from pointkit.tables import write_table
from puckbench.report.build import build_page
from puckbench.report.contents import Contents
from puckbench.report.findings import Findings, findings
from puckbench.report.reference_results import ReferenceResults, read_reference, shipped_studies
from puckbench.tables.rate_deltas import bd_rate, bd_rate_clouds, bd_rate_pairs
from puckbench.tables.registry import table_entry
from puckbench.tables.uses import uses

if TYPE_CHECKING:
    import pandas as pd


def study_findings(reference: ReferenceResults) -> Findings:
    """Return the findings of a study, computed in the same way as those of a run."""
    return findings(reference.metrics, _comparisons(reference), reference.style)


def write_study(reference: ReferenceResults, folder: Path) -> Path:
    """Write the page and the tables of a study.

    Parameters
    ----------
    reference
        Results of the study.
    folder
        Folder in which ``index.html`` and the folder ``tables`` are written. ``tables/metrics.csv``
        contains all results.

    Returns
    -------
    Path
        Path of the page.
    """
    tables = folder / "tables"
    summary = table_entry("summary").make(metrics=reference.metrics)
    tables_by_name = {"summary": summary, **_comparisons(reference)}
    tables_by_name |= {name: reference.table(name) for name in ("clouds", "scan_errors")}
    present = {name: table for name, table in tables_by_name.items() if table is not None}
    for name, table in present.items():
        write_table(table, tables / f"{name}.csv")
    write_table(reference.metrics, tables / "metrics.csv")
    contents = Contents(
        title=f"Reference results: {reference.title}",
        metrics=str(tables / "metrics.csv"),
        tables={name: str(tables / f"{name}.csv") for name in present},
        configuration=reference.about["configuration"],
        style=tuple(reference.about["style"]),
    )
    page = folder / "index.html"
    remarks = {"Times": f"not timed: {reference.not_timed}"} if reference.not_timed else {}
    text = build_page(contents, reference.about["machine"], folder, reference.record, remarks)
    write_bytes(page, text.encode())
    return page


def _comparisons(reference: ReferenceResults) -> dict[str, pd.DataFrame]:
    if reference.metrics["codec"].nunique() < 2:
        return {}
    metrics, options = reference.metrics, reference.bd_rate
    errors, margin = reference.table("scan_errors"), options["margin_percent"]
    return {
        "uses": uses(metrics, errors, margin),
        "bd_rate": bd_rate(metrics, **options),
        "bd_rate_pairs": bd_rate_pairs(metrics, **options),
        "bd_rate_clouds": bd_rate_clouds(metrics, options["anchor"], options["qualities"]),
    }


if __name__ == "__main__":
    for study in shipped_studies():
        write_study(read_reference(study), Path(sys.argv[1]) / study)
