"""The tables of the sensor study and of the benchmark: what makes each, and from which inputs.

Listing imports no pandas, so that the workflow can plan with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from puckbench.errors import InputError


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


_HERE = "puckbench.analysis"

REGISTRY: dict[str, TableEntry] = {
    "table_4_1": TableEntry(f"{_HERE}.printed_tables:table_4_1"),
    "table_4_2": TableEntry(f"{_HERE}.printed_tables:table_4_2"),
    "table_5_1": TableEntry(f"{_HERE}.printed_tables:table_5_1"),
    "residual_statistics": TableEntry(
        f"{_HERE}.residual_statistics:residual_statistics", ("residuals",)
    ),
    "residual_incidence": TableEntry(f"{_HERE}.incidence_effect:incidence_table", ("residuals",)),
    "incidence_effect": TableEntry(
        f"{_HERE}.incidence_effect:incidence_effect", ("scans", "residuals")
    ),
    "thesis_numbers": TableEntry(f"{_HERE}.thesis_numbers:thesis_numbers", ("residuals",)),
    "model_distances": TableEntry(f"{_HERE}.comparison:model_distances", ("compared",)),
}
"""Tables of the sensor study (thesis chapter 5)."""

RESULTS: dict[str, TableEntry] = {
    "bd_rate": TableEntry(f"{_HERE}.bd_tables:bd_rate", ("metrics",)),
    "bd_rate_clouds": TableEntry(f"{_HERE}.bd_tables:bd_rate_clouds", ("metrics",)),
    "machines": TableEntry(f"{_HERE}.machines:machines", ("metrics",)),
}
"""Tables of the benchmark (chapter 6) beyond those of `puckbench.tables`."""

VERDICTS: dict[str, TableEntry] = {
    "thesis_medians": TableEntry(f"{_HERE}.thesis_medians:thesis_medians", ("metrics",)),
    "gpcc_scales": TableEntry(f"{_HERE}.gpcc_scales:gpcc_scales", ("metrics",)),
    "claims": TableEntry(
        f"{_HERE}.claims.table:claims",
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
