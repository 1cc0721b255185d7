"""The tables of the sensor study and of the benchmark: what makes each, and from which inputs.

Listing imports no pandas, so that the workflow can plan with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from puckbench.core.errors import InputError


@dataclass(frozen=True)
class TableEntry:
    """One table: a dotted "module:function" and its inputs' names.

    The function takes every input as a DataFrame under its name, further options of its own as
    keywords, and returns a DataFrame. Inputs are "residuals", the residual tables of all models in
    one; "scans", their points likewise; "compared", real walls and error models on the same rays,
    where there are captures; "metrics", all results of the benchmark; or the name of another table.
    optional: inputs that are given where a run has them. category: where the report lists it.
    """

    function: str
    inputs: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    category: str = "Tables"

    def load(self) -> Callable[..., Any]:
        """The function itself, imported now."""
        module, name = self.function.split(":")
        function: Callable[..., Any] = getattr(import_module(module), name)
        return function


REGISTRY: dict[str, TableEntry] = {
    "table_4_1": TableEntry("puckbench.thesis.printed_tables:table_4_1"),
    "table_4_2": TableEntry("puckbench.thesis.printed_tables:table_4_2"),
    "table_5_1": TableEntry("puckbench.thesis.printed_tables:table_5_1"),
    "residual_statistics": TableEntry(
        "puckbench.thesis.residuals.statistics:residual_statistics", ("residuals",)
    ),
    "residual_incidence": TableEntry(
        "puckbench.thesis.residuals.incidence_effect:incidence_table", ("residuals",)
    ),
    "incidence_effect": TableEntry(
        "puckbench.thesis.residuals.incidence_effect:incidence_effect", ("scans", "residuals")
    ),
    "thesis_numbers": TableEntry("puckbench.thesis.numbers:thesis_numbers", ("residuals",)),
    "model_distances": TableEntry(
        "puckbench.thesis.residuals.model_comparison:model_distances", ("compared",)
    ),
}
"""Tables of the sensor study (thesis chapter 5)."""

RESULTS: dict[str, TableEntry] = {
    "bd_rate": TableEntry("puckbench.metrics.rate_deltas:bd_rate", ("metrics",)),
    "bd_rate_clouds": TableEntry("puckbench.metrics.rate_deltas:bd_rate_clouds", ("metrics",)),
    "machines": TableEntry("puckbench.jobs.machines:machines", ("metrics",)),
}
"""Tables of the benchmark (chapter 6) beyond those of `puckbench.jobs.result_tables`."""

VERDICTS: dict[str, TableEntry] = {
    "thesis_medians": TableEntry("puckbench.thesis.medians:thesis_medians", ("metrics",)),
    "gpcc_scales": TableEntry("puckbench.thesis.gpcc_scales:gpcc_scales", ("metrics",)),
    "claims": TableEntry(
        "puckbench.thesis.claims.table:claims",
        optional=(
            "metrics",
            "clouds",
            "residual_statistics",
            "thesis_numbers",
            "incidence_effect",
        ),
        category="Claims",
    ),
}
"""Tables that hold results against the thesis, or codecs against their settings."""


def table_entry(name: str) -> TableEntry:
    """The entry of the table called `name`; InputError when there is none."""
    known = REGISTRY | RESULTS | VERDICTS
    if name not in known:
        raise InputError(f"unknown table {name!r}; there are {', '.join(known)}")
    return known[name]
