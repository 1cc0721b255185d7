from __future__ import annotations

from collections.abc import Iterable, Mapping
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pydantic import Field

from pointkit.errors import InputError
from puckbench.core.code import TABLES
from puckbench.steps.sensing import code_of_models
from puckbench.steps.step import STEPS, Paths, PlannedStep, Step, planned
from puckbench.tables.registry import TABLES as REGISTRY
from puckbench.tables.registry import TableEntry, table_entry
from virtual_lidar import open_error_model

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.planning.workflow import Workflow

CODE = TABLES

_DIGITS = 6
"""Number of significant digits to which a table's numbers are rounded."""


@STEPS.register("table")
class Table(Step):
    """Make a registered table from other tables.

    Parameters
    ----------
    table
        Name of the table, or place (``file.py:function``) of the user's own.
    options
        Keyword arguments of the function that makes the table, besides its inputs.
    """

    table: str
    options: dict[str, Any] = Field({})

    @classmethod
    def of_plan(cls, flow: Workflow, /, table: str) -> PlannedStep:
        outputs, entry = flow.outputs, table_entry(table)
        inputs = outputs.tables[table]
        modules, parameters = code_of_models(map(open_error_model, entry.error_models))
        present = " ".join(inputs) if entry.optional else ""
        step = cls(table=REGISTRY.place_of(table), options=outputs.table_options(table))
        code = (REGISTRY.module_of(table), *modules)
        return planned(step, inputs, *code, also=f"{parameters} {present}")

    def plugins(self) -> Iterable[str | None]:
        return (self.table,)

    def run(self, out: Paths, columns: Path | None = None, **inputs: Path) -> dict[str, Any]:
        """Write the table, and return the number of rows and the files.

        Parameters
        ----------
        out
            Files to write, in the formats of their suffixes (``.csv``, ``.parquet``, ``.tex``).
        columns
            If set, file to which a table with the meanings of the columns is written.
        inputs
            Files of the tables that the function reads, by the names of its parameters.
        """
        from puckbench.tables.files import write_result

        shown = table_entry(self.table).shown
        rows = write_result(self.made(inputs), columns, *out, usual=shown)
        return {"table": self.table, **rows, "files": [str(path) for path in out]}

    def made(self, inputs: Mapping[str, Path]) -> pd.DataFrame:
        """Return the table, made from the files of its inputs (see `run`)."""
        from pointkit.tables import read_table

        entry = table_entry(self.table)
        if missing := [needed for needed in entry.inputs if needed not in inputs]:
            raise InputError(f"table {self.table}: needs the input {missing[0]!r}")
        used = [name for name in (*entry.inputs, *entry.optional) if name in inputs]
        table = self._made(entry, {name: read_table(inputs[name]) for name in used})
        for column in table.select_dtypes("floating"):
            table[column] = [float(f"{value:.{_DIGITS}g}") for value in table[column]]
        return cast("pd.DataFrame", table)

    def _made(self, entry: TableEntry, inputs: dict[str, pd.DataFrame]) -> Any:
        try:
            signature(entry.make).bind(**inputs, **self.options)
        except TypeError as error:
            raise InputError(f"table {entry.name}: options: {error}") from error
        return entry.make(**inputs, **self.options)
