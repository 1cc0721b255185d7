"""The tables of a run's results: how one is registered, and from what it is made.

A table is one function with its registration above it; the docstring up to its first section is the
caption::

    @TABLES.register("machines", title="Machines and versions")
    def machines(metrics: pd.DataFrame) -> pd.DataFrame:
        \"\"\"On what the times were taken.\"\"\"

Parameters that are DataFrames name its inputs: "metrics", all results of the benchmark; "clouds";
"residuals" and "scans", the measurements of all error models in one; "compared", real walls and
error models on the same rays; or the name of another table. Those with a default are given where a
run has them; parameters of another kind are options. Planning imports the modules of all tables, so
these import pandas in functions only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from puckbench.core.registry import Registry
from puckbench.core.signatures import annotated, caption_of, defaulted

SENSOR = "Sensor, tables"
"""Category of the tables of the sensor study (thesis chapter 5)."""
STUDY = "sensor_study"
"""Needed of a configuration: the sensor study."""
SEVERAL_CODECS = "codecs"
"""Needed of a configuration: a codec beside the anchor of Bjontegaard deltas."""
SPINS_OR_RECORDINGS = "metric"
"""What a table may need of a configuration: clouds in metres with a sensor's returns."""
SEVERAL_NOISES = "noises"
"""Needed of a configuration: spins in the same scenes under several error models."""
OCTREE_AND_OTHERS = "octree"
"""Needed of a configuration: the codec ``gpcc``, and another one of clouds in metres."""


@dataclass(frozen=True)
class TableEntry:
    """A registered table.

    Parameters
    ----------
    name
        Of its files and of its job.
    make
        Takes each input as a DataFrame, and options, by keyword; returns a DataFrame.
    title, category
        How the report lists it.
    thesis
        Number of the thesis's table; empty for others.
    needs
        What a configuration must have beside the inputs: `STUDY`, `SEVERAL_CODECS`,
        `SPINS_OR_RECORDINGS`, `SEVERAL_NOISES`, `OCTREE_AND_OTHERS`, or the table's own name where
        only a plan can tell.
    gathered
        Whether the workflow gathers it from files of many jobs, not from other tables.
    """

    name: str
    make: Callable[..., Any]
    title: str = ""
    category: str = "Tables"
    thesis: str = ""
    needs: tuple[str, ...] = ()
    gathered: bool = False

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the tables that it is always made from."""
        return tuple(
            name for name in annotated(self.make, "DataFrame") if name not in self.optional
        )

    @property
    def optional(self) -> tuple[str, ...]:
        """Names of the tables that it uses where a run has them."""
        may_lack = defaulted(self.make)
        return tuple(name for name in annotated(self.make, "DataFrame") if name in may_lack)

    @property
    def caption(self) -> str:
        """What the report says above the table, in reStructuredText."""
        return caption_of(self.make)


TABLES: Registry[TableEntry] = Registry("table", "tables", make=TableEntry)


def table_entry(name: str) -> TableEntry:
    """The table of a name, or of ``path/to/file.py:function``; InputError when there is none."""
    return TABLES.get(name)


def table_entries() -> dict[str, TableEntry]:
    """All tables by name."""
    return {name: TABLES.get(name) for name in TABLES.names()}
