from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pointkit.models import Model, parsed
from puckbench.figures.registry import FIGURES
from puckbench.tables.registry import TABLES

TITLE = "Point-cloud compression on virtual LiDAR scans"


class Example(Model):
    """Files of a cloud in the report's viewer: the cloud that was coded, and its decoded versions.

    Parameters
    ----------
    kind
        "object", "raw", "clean" or "noisy".
    dataset, cloud
        Names of the data set and of the cloud.
    original
        PLY file of the cloud.
    decoded
        For each codec and rate, a PLY file of the decoded cloud, or an archive (.zip) that contains
        it as ``<rate>.ply``.
    """

    kind: str
    dataset: str
    cloud: str
    original: str
    decoded: Mapping[str, Mapping[str, str]]


class Contents(Model):
    """The files of which a report page is made, and options of the page.

    Parameters
    ----------
    title
        Title of the page.
    metrics
        File of the results; None for a run without results of codecs.
    tables, figures
        Files of tables, and pictures of figures, by name.
    own_figures, own_tables
        Places of the user's figures and tables (see `pointkit.registry`), which are loaded if they
        are trusted.
    examples
        Clouds in the viewer.
    logs
        Folder with the logs of the jobs.
    configuration
        Configuration of the run.
    style
        Options of `puckbench.figures.style.FigureStyle`; later entries take precedence.
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
        """Return contents from a JSON object; raise InputError if a value is not valid."""
        return parsed(cls, value, "contents of the report")

    def under(self, folder: Path) -> Contents:
        """Return these contents with all paths below `folder`, which has a copy of the files."""

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
        """Return the contents as a JSON object, which `from_json` reads."""
        return self.model_dump(mode="json")

    def files(self) -> list[str]:
        """Return the paths of all files that the page is made of."""
        metrics = [] if self.metrics is None else [self.metrics]
        originals = [example.original for example in self.examples]
        decoded = [files for example in self.examples for files in example.decoded.values()]
        coded = [file for files in decoded for file in files.values()]
        tables, figures = self.tables.values(), self.figures.values()
        return list(dict.fromkeys([*metrics, *tables, *figures, *originals, *coded]))


def register_user_plugins(figures: Iterable[str], tables: Iterable[str]) -> None:
    """Register the user's figures and tables, so that the page can show them.

    Parameters
    ----------
    figures, tables
        Places of functions, such as ``path/to/file.py:function``.

    Raises
    ------
    InputError
        The user does not trust a file.
    """
    for place in figures:
        FIGURES.add(place)
    for place in tables:
        TABLES.add(place)
