"""The registry of tables computed from a run's results.

A table is a function; its docstring up to the first section is the caption::

    @TABLES.register("machines", title="Machines and versions")
    def machines(metrics: pd.DataFrame) -> pd.DataFrame:
        \"\"\"Machines on which times were measured.\"\"\"

DataFrame parameters are inputs, optional if they have a default: "metrics" (all results), "clouds",
"residuals" and "scans" (of all error models), "compared" (real walls and error models on the same
rays), or another table. Other parameters are options. ``columns=`` declares the columns that only
this table has (`puckbench.results.columns`). Import pandas in functions, since planning imports
modules of tables.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import puckbench.metrics.metric_registry  # noqa: F401 (declares the columns of further metrics)
from pointkit.registry import Registry
from puckbench.core.introspection import caption_of, optional_parameters, typed_parameters
from puckbench.results.columns import Columns, declare, declared_by
from puckbench.results.sameness import Timed

SENSOR = "Sensor, tables"
"""Category of tables of the sensor study."""
STUDY = "sensor_study"
"""Requirement: a sensor study."""
SEVERAL_CODECS = "codecs"
"""Requirement: a codec besides the anchor of Bjontegaard deltas."""
SPINS_OR_RECORDINGS = "metric"
"""Requirement: clouds in metres with a sensor's returns."""
TRUTH = "truth"
"""Requirement: scans of scenes with a true surface."""
SEVERAL_NOISES = "noises"
"""Requirement: virtual scans of the same scenes under several error models."""
ODOMETRY = "odometry"
"""Requirement: drives with the task ``odometry`` or ``gicp_odometry``."""
PERCEPTION = "perception"
"""Requirement: metrics or tasks of drives that declare by what they are judged."""
SEGMENTATION = "segmentation"
"""Requirement: a metric of segmentation on a coded data set."""
ATTRIBUTES = "attributes"
"""Requirement: a codec that codes attributes."""
OCTREE_AND_OTHERS = "octree"
"""Requirement: the codec ``gpcc`` and another codec on clouds in metres."""


PUBLISHED = "published"
"""Requirement: a data set of which the configuration gives the published name."""

UNDECODED = "undecoded"
"""Value of ``codec`` for drives that were not coded."""


@dataclass(frozen=True)
class TableEntry:
    """A registered table, made by a function from the results of a run.

    Parameters
    ----------
    name
        Name under which the table is registered.
    make
        Function that returns a DataFrame from inputs and options, passed by keyword.
    title
        Title in the report.
    category
        Heading under which the report lists the table.
    number
        Number of the table in a publication, or empty.
    needs
        What a run must contain besides the inputs (`puckbench.planning.needs`).
    gathered
        Whether the workflow collects the table from files of many jobs.
    error_models
        Names of error models whose parameters the function reads.
    shown
        Columns that LaTeX shows of a wide table (`usual` in `puckbench.tables.latex`).
    timed
        What depends on the speed of the machine besides columns of times
        (`puckbench.results.sameness.Timed`).
    """

    name: str
    make: Callable[..., Any]
    title: str = ""
    category: str = "Tables"
    number: str = ""
    needs: tuple[str, ...] = ()
    gathered: bool = False
    error_models: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()
    timed: Timed = field(default_factory=dict)

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the input tables that the function requires."""
        return tuple(
            name for name in typed_parameters(self.make, "DataFrame") if name not in self.optional
        )

    @property
    def optional(self) -> tuple[str, ...]:
        """The names of the input tables that the function uses if they exist."""
        may_lack = optional_parameters(self.make)
        return tuple(name for name in typed_parameters(self.make, "DataFrame") if name in may_lack)

    @property
    def caption(self) -> str:
        """The text of the function's docstring before its first section."""
        return caption_of(self.make)


def _registered(
    name: str, make: Callable[..., Any], columns: Columns = (), **more: Any
) -> TableEntry:
    declare(columns)
    return TableEntry(name, make, **more)


TABLES: Registry[TableEntry] = Registry("table", "tables", make=_registered)
declared_by(TABLES.names)


def table_entry(name: str) -> TableEntry:
    """Return a registered table.

    Parameters
    ----------
    name
        Name of a table, or ``path/to/file.py:function``.

    Raises
    ------
    InputError
        There is no such table.
    """
    return TABLES.get(name)


def table_entries() -> dict[str, TableEntry]:
    """Return all registered tables by name."""
    return {name: TABLES.get(name) for name in TABLES.names()}
