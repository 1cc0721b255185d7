"""What a report is made from: files of a run, and its configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from puckbench.core.models import Model, parsed
from puckbench.figures.registry import FIGURES
from puckbench.metrics.table_registry import TABLES

TITLE = "Point-cloud compression on virtual LiDAR scans"
POINTS = 20_000
MOST_MB = 8.0


class Example(Model):
    """One cloud of the viewer and its decoded versions.

    Parameters
    ----------
    kind
        Which example of the configuration it is ("object", "raw", "clean", "noisy").
    dataset, cloud
        Their names.
    original
        File of the prepared cloud.
    decoded
        Files of the decoded clouds by codec, then by rate; or archives (.zip) that have the cloud
        of the rate r1 as ``r1.ply``.
    """

    kind: str
    dataset: str
    cloud: str
    original: str
    decoded: Mapping[str, Mapping[str, str]]


class Contents(Model):
    """The files that a page shows, by name, and how.

    Parameters
    ----------
    title
        Of the page.
    metrics
        File of all results, None without one.
    tables, figures
        Name -> file (CSV; PNG).
    own_figures, own_tables
        Places of those that are a user's own; they are loaded where they are trusted.
    examples
        Clouds of the viewer.
    logs
        Folder of the logs of the run's jobs, None where there are none.
    configuration
        The checked one.
    style
        Layers of `puckbench.figures.style.FigureStyle`, a later one before an earlier one.
    points
        Of each cloud in the viewer at most; fewer where all would take more than `most_mb`.
    most_mb
        Megabytes of all clouds in the page at most.
    """

    title: str = TITLE
    metrics: str | None = None
    tables: Mapping[str, str] = {}
    figures: Mapping[str, str] = {}
    own_figures: tuple[str, ...] = ()
    own_tables: tuple[str, ...] = ()
    examples: tuple[Example, ...] = ()
    logs: str | None = None
    configuration: Mapping[str, Any] = {}
    style: tuple[Mapping[str, Any], ...] = ()
    points: int = POINTS
    most_mb: float = MOST_MB

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Contents:
        """The contents in a JSON object; InputError names what it may not hold."""
        return parsed(cls, value, "contents of the report")

    def under(self, folder: Path) -> Contents:
        """The same contents with all files in a copy of their folders, below another one."""

        def moved(files: Mapping[str, str]) -> dict[str, str]:
            return {name: str(folder / file) for name, file in files.items()}

        return self.replaced(
            metrics=None if self.metrics is None else str(folder / self.metrics),
            tables=moved(self.tables),
            figures=moved(self.figures),
            examples=tuple(
                example.replaced(
                    original=str(folder / example.original),
                    decoded={codec: moved(files) for codec, files in example.decoded.items()},
                )
                for example in self.examples
            ),
        )

    def as_json(self) -> dict[str, Any]:
        """The JSON object that `from_json` reads."""
        return self.model_dump(mode="json")

    def files(self) -> list[str]:
        """Every file that the page is made from."""
        metrics = [] if self.metrics is None else [self.metrics]
        originals = [example.original for example in self.examples]
        decoded = [files for example in self.examples for files in example.decoded.values()]
        coded = [file for files in decoded for file in files.values()]
        tables, figures = self.tables.values(), self.figures.values()
        return list(dict.fromkeys([*metrics, *tables, *figures, *originals, *coded]))


def add_own(figures: Iterable[str], tables: Iterable[str]) -> None:
    """List a user's own figures and tables, by their places, beside ours.

    InputError where a place is not trusted (`puckbench.core.registry.trust`).
    """
    for place in figures:
        FIGURES.add(place)
    for place in tables:
        TABLES.add(place)
