from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pointkit.models import Model, parsed
from puckbench.figures.registry import FIGURES
from puckbench.metrics.table_registry import TABLES

TITLE = "Point-cloud compression on virtual LiDAR scans"


class Example(Model):
    """Files of a cloud in the viewer: the prepared cloud and its decoded versions.

    `kind` is "object", "raw", "clean" or "noisy". `decoded` has a PLY file, or an archive (.zip)
    that contains ``<rate>.ply``, for each codec and rate.
    """

    kind: str
    dataset: str
    cloud: str
    original: str
    decoded: Mapping[str, Mapping[str, str]]


class Contents(Model):
    """The files for a report page, and options.

    Parameters
    ----------
    own_figures, own_tables
        Places of the user's figures and tables (see `pointkit.registry`), loaded if trusted.
    style
        Layers of `puckbench.figures.style.FigureStyle`; later layers take precedence.
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

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Contents:
        return parsed(cls, value, "contents of the report")

    def under(self, folder: Path) -> Contents:
        """Return the contents with paths below `folder`, which holds a copy of the results."""

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
        return self.model_dump(mode="json")

    def files(self) -> list[str]:
        metrics = [] if self.metrics is None else [self.metrics]
        originals = [example.original for example in self.examples]
        decoded = [files for example in self.examples for files in example.decoded.values()]
        coded = [file for files in decoded for file in files.values()]
        tables, figures = self.tables.values(), self.figures.values()
        return list(dict.fromkeys([*metrics, *tables, *figures, *originals, *coded]))


def register_user_plugins(figures: Iterable[str], tables: Iterable[str]) -> None:
    """Register the user's plug-ins (``file.py:name``); raise InputError if untrusted."""
    for place in figures:
        FIGURES.add(place)
    for place in tables:
        TABLES.add(place)
