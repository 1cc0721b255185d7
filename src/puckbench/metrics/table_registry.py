"""The registry of tables computed from a run's results.

A table is a function, whose docstring up to the first section is the caption; CONTRIBUTING.md has
an example. DataFrame parameters are inputs: "metrics" (all results), "clouds", "residuals" and
"scans" (of all error models), "compared" (real walls and error models on the same rays), or another
table; optional with a default. Other parameters are options. Planning imports these modules: import
pandas in functions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from puckbench.core.introspection import caption_of, optional_parameters, typed_parameters
from puckbench.core.registry import Registry

SENSOR = "Sensor, tables"
"""Category of tables of the sensor study (thesis chapter 5)."""
STUDY = "sensor_study"
"""Requirement: the configuration has a sensor study."""
SEVERAL_CODECS = "codecs"
"""Requirement: a codec besides the anchor of Bjontegaard deltas."""
SPINS_OR_RECORDINGS = "metric"
"""Requirement: clouds in metres with a sensor's returns."""
TRUTH = "truth"
"""Requirement: scans of scenes whose true surface is available."""
SEVERAL_NOISES = "noises"
"""Requirement: virtual scans of the same scenes under several error models."""
ODOMETRY = "odometry"
"""Requirement: drives with the task of this name."""
ATTRIBUTES = "attributes"
"""Requirement: a codec that codes attributes."""
OCTREE_AND_OTHERS = "octree"
"""Requirement: the codec ``gpcc`` and another codec on clouds in metres."""


UNDECODED = "undecoded"
"""Name in the column of codecs for a drive that is not coded."""


@dataclass(frozen=True)
class TableEntry:
    """A registered table.

    Parameters
    ----------
    make
        Function from inputs and options, passed by keyword, to a DataFrame.
    number
        Number of the table in a publication, or empty.
    needs
        Conditions of a plan besides the inputs (`puckbench.planning.needs`).
    gathered
        Whether the workflow collects the table from files of many jobs.
    """

    name: str
    make: Callable[..., Any]
    title: str = ""
    category: str = "Tables"
    number: str = ""
    needs: tuple[str, ...] = ()
    gathered: bool = False

    @property
    def inputs(self) -> tuple[str, ...]:
        return tuple(
            name for name in typed_parameters(self.make, "DataFrame") if name not in self.optional
        )

    @property
    def optional(self) -> tuple[str, ...]:
        may_lack = optional_parameters(self.make)
        return tuple(name for name in typed_parameters(self.make, "DataFrame") if name in may_lack)

    @property
    def caption(self) -> str:
        return caption_of(self.make)


TABLES: Registry[TableEntry] = Registry("table", "tables", make=TableEntry)


def table_entry(name: str) -> TableEntry:
    """Return a table by name or ``path/to/file.py:function``, or raise InputError."""
    return TABLES.get(name)


def table_entries() -> dict[str, TableEntry]:
    return {name: TABLES.get(name) for name in TABLES.names()}
