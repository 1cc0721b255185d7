from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from typing import Any

from puckbench.planning.plan import Plan
from puckbench.report.contents import Contents, Example

FIRST_TABLES = ("summary", "clouds", "left_out", "scan_errors")
"""Names of the tables that come first in every report."""


def planned_contents(
    plan: Plan,
    figures: Iterable[str],
    gathered: Container[str],
    tables: Collection[str],
    style: Sequence[Mapping[str, Any]],
) -> Contents:
    """Return what the report of a run shows, with the paths of all files.

    Parameters
    ----------
    plan
        The plan of the run.
    figures
        Names of the figures that are drawn.
    gathered
        Names of the tables that join the results of many jobs.
    tables
        Names of the other tables.
    style
        Options of the style of figures, in layers, each of which overrides earlier ones.
    """
    settings = plan.config.report
    folder = plan.results / "tables"
    first = [name for name in FIRST_TABLES if name in gathered or name in tables]
    return Contents(
        title=settings.title,
        metrics=str(folder / "metrics.parquet") if "metrics" in gathered else None,
        tables={name: str(folder / f"{name}.csv") for name in (*first, *tables)},
        figures={name: str(plan.results / "figures" / f"{name}.png") for name in figures},
        own_figures=plan.config.figures.own,
        own_tables=plan.config.tables,
        examples=tuple(_examples(plan)),
        logs=str(plan.results / "logs"),
        configuration=plan.config.as_json(),
        style=tuple(style),
    )


def _examples(plan: Plan) -> Iterable[Example]:
    for kind, name in plan.examples.items():
        dataset, cloud = name.split("/")
        original = plan.results / "clouds" / dataset / f"{cloud}.ply"
        folder = plan.results / "decoded" / dataset / cloud
        decoded = {
            codec: dict.fromkeys(shown, str(folder / f"{codec}.zip"))
            for codec in plan.codecs
            if plan.codes(codec, dataset)
            and not plan.has_failed("decoded", dataset, cloud, codec)
            and (shown := plan.shown_rates(dataset, cloud, codec))
        }
        yield Example(
            kind=kind, dataset=dataset, cloud=cloud, original=str(original), decoded=decoded
        )
