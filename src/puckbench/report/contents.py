"""What a report is made from: files of a run, and what its configuration says of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from puckbench.core.errors import InputError

TITLE = "Point-cloud compression on virtual LiDAR scans"
POINTS = 20_000
MOST_MB = 8.0


@dataclass(frozen=True)
class Example:
    """One cloud of the viewer and what codecs made of it.

    kind: which example of the configuration it is ("object", "raw", "clean", "noisy"). original:
    file of the prepared cloud. decoded: files of the decoded clouds by codec, then by rate.
    """

    kind: str
    dataset: str
    cloud: str
    original: str
    decoded: Mapping[str, Mapping[str, str]]


@dataclass(frozen=True)
class Contents:
    """The files that a page shows, by name, and how.

    metrics: file of all results, None without one. tables, figures: name -> file (CSV; PNG).
    captions: folder with NAME.rst for figures and tables. configuration: the checked one.
    style: layers of `puckbench.figures.style.FigureStyle`. points: of each cloud in the viewer at
    most; fewer where all of them together would take more than most_mb.
    """

    title: str = TITLE
    metrics: str | None = None
    tables: Mapping[str, str] = field(default_factory=dict)
    figures: Mapping[str, str] = field(default_factory=dict)
    captions: str | None = None
    examples: tuple[Example, ...] = ()
    configuration: Mapping[str, Any] = field(default_factory=dict)
    style: tuple[Mapping[str, Any], ...] = ()
    points: int = POINTS
    most_mb: float = MOST_MB

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Contents:
        """The contents in a JSON object; InputError names a key that there is not."""
        examples = tuple(_checked(Example, item) for item in value.get("examples", ()))
        layers = {"examples": examples, "style": tuple(value.get("style", ()))}
        made: Contents = _checked(cls, {**value, **layers})
        return made

    def as_json(self) -> dict[str, Any]:
        """The JSON object that `from_json` reads."""
        return asdict(self)

    def files(self) -> list[str]:
        """Every file that the page is made from but the captions."""
        coded = [
            file
            for example in self.examples
            for files in (example.decoded[codec] for codec in example.decoded)
            for file in files.values()
        ]
        originals = [example.original for example in self.examples]
        metrics = [] if self.metrics is None else [self.metrics]
        return [*metrics, *self.tables.values(), *self.figures.values(), *originals, *coded]


def _checked(kind: Any, values: Mapping[str, Any]) -> Any:
    """A data class of these values; InputError for an unknown or a missing one."""
    try:
        return kind(**values)
    except TypeError as error:
        raise InputError(f"contents of the report: {str(error).split('() ')[-1]}") from error
