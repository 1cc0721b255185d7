"""Further sections of the report's page, which other packages add in their module ``sections``.

A section is a function that turns tables of a run into HTML::

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
    """The parts of a run that a section of the page can show.

    Parameters
    ----------
    tables
        Tables of the run that have rows, by name.
    links
        Links from the page to the CSV files of the tables, by name of the table.
    figures
        Titles of the figures on the page, by name. The figure ``x`` has the anchor ``#figure-x``.
    """

    tables: Mapping[str, pd.DataFrame]
    links: Mapping[str, str]
    figures: Mapping[str, str]


@dataclass(frozen=True)
class Section:
    """A registered section of the page, which follows the findings.

    Parameters
    ----------
    name
        Name of the section.
    make
        Function that returns the section's HTML, or None if there is nothing to show
        (`puckbench.report.page.filled` makes HTML from a template).
    title
        Heading of the section.
    tables
        Names of the tables that the section shows. A page has the section if the run has rows of
        all these tables. It then does not list them among its other tables.
    """

    name: str
    make: Callable[[SectionData], Markup | None]
    title: str
    tables: tuple[str, ...]


SECTIONS: Registry[Section] = Registry("report section", "sections", make=Section)


def sections_of(tables: Mapping[str, object]) -> list[Section]:
    """Return the sections for which a run has all tables.

    Parameters
    ----------
    tables
        Tables of the run that have rows, by name.
    """
    sections = [SECTIONS.get(name) for name in SECTIONS.names()]
    return [section for section in sections if tables.keys() >= set(section.tables)]
