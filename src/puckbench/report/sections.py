"""Further sections of the report, which other packages add in their module ``sections``.

A section is a function from a run's tables to HTML::

    @SECTIONS.register("machines", title="Machines", tables=("machines",))
    def machines(data: SectionData) -> Markup | None:
        return filled("<p>{{ count }} machines</p>", count=len(data.tables["machines"]))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pointkit.registry import Registry

if TYPE_CHECKING:
    import pandas as pd
    from markupsafe import Markup


@dataclass(frozen=True)
class SectionData:
    """What a section can show of a run.

    Parameters
    ----------
    tables
        Tables of the run that have rows, by name.
    links
        Relative links from the page to the tables' CSV files, by name of the table.
    figures
        Titles of the figures on the page, by name; the figure ``x`` has the anchor ``#figure-x``.
    """

    tables: Mapping[str, pd.DataFrame]
    links: Mapping[str, str]
    figures: Mapping[str, str]


@dataclass(frozen=True)
class Section:
    """A registered section, which follows the findings.

    Parameters
    ----------
    make
        Function that returns the section's HTML, or None if there is nothing to show
        (`puckbench.report.page.filled` makes HTML from a template).
    title
        Heading of the section.
    tables
        Tables that the section shows. A page has the section if the run has rows of all of them,
        and then does not list them among its tables.
    """

    name: str
    make: Callable[[SectionData], Markup | None]
    title: str
    tables: tuple[str, ...]


SECTIONS: Registry[Section] = Registry("report section", "sections", make=Section)


def sections_of(tables: Mapping[str, object]) -> list[Section]:
    """Return the sections whose tables are all among those of a run."""
    sections = [SECTIONS.get(name) for name in SECTIONS.names()]
    return [section for section in sections if tables.keys() >= set(section.tables)]
