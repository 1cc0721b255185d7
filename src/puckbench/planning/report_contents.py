from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from typing import Any

from puckbench.planning.plan import Plan
from puckbench.report.contents import Contents, Example

FIRST_TABLES = ("summary", "clouds", "left_out", "scan_errors")
"""Tables that come first in the report of every benchmark."""


def planned_contents(
    plan: Plan,
    figures: Iterable[str],
    gathered: Container[str],
    tables: Collection[str],
    style: Sequence[Mapping[str, Any]],
) -> Contents:
    """Plan the report of a run with these figures, gathered tables and other tables."""
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
            and (shown := shown_rates(plan, dataset, cloud, codec))
        }
        yield Example(
            kind=kind, dataset=dataset, cloud=cloud, original=str(original), decoded=decoded
        )


def shown_rates(plan: Plan, dataset: str, cloud: str, codec: str) -> tuple[str, ...]:
    rates = plan.rates(codec, plan.datasets[dataset].frame)
    coded = plan.curve_rates(dataset, cloud, codec)
    return tuple(rate for rate in spread_out(rates, plan.config.report.rates) if rate in coded)


def spread_out(names: Sequence[str], count: int) -> list[str]:
    if count >= len(names):
        return list(names)
    if count == 1:
        return [names[len(names) // 2]]
    step = (len(names) - 1) / (count - 1)
    return [names[round(place * step)] for place in range(count)]
