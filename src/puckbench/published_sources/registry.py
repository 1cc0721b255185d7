"""The registry of sources of published numbers, i.e. of papers and repositories with results.

A source is a function that returns a table with the columns of `puckbench.published_sources.rows`.
It usually reads a CSV file beside its module::

    @SOURCES.register("cloudini", title="Cloudini", address="...", licence="Apache-2.0")
    def cloudini() -> pd.DataFrame:
        return rows_beside(__file__, "the SHA-256 of cloudini.csv")

The CSV file is known by its digest, so that jobs run again when it changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from pointkit.errors import InputError, among, naming
from pointkit.registry import Registry

if TYPE_CHECKING:
    import pandas as pd

SUFFIX = ".csv"
PCHIP, CUBIC = "PCHIP", "cubic fit"
"""Interpolations of rate-distortion curves: piecewise cubic Hermite polynomials, and one cubic
polynomial fitted to the whole curve (VCEG-M33)."""


@dataclass(frozen=True)
class Source:
    """A publication whose numbers are shown beside those of runs.

    Parameters
    ----------
    name
        Name under which the source is registered.
    read
        Function that returns the rows of the source, as `puckbench.published_sources.rows` checks
        them.
    title
        Title in figures and tables.
    address
        Where the numbers were published.
    licence
        Licence of the publication, of which only numbers are here.
    interpolation
        `PCHIP` or `CUBIC`: how the source computes its BD-rates; empty if it prints none.
    remark
        What a reader must know of all numbers of the source; may be empty.
    """

    name: str
    read: Callable[[], pd.DataFrame]
    title: str
    address: str
    licence: str
    interpolation: str = ""
    remark: str = ""

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows of the source. Raises InputError, which names the source, if one is invalid."""
        from puckbench.published_sources.rows import check_rows

        with naming(f"published numbers of {self.name}"):
            table = self.read()
            check_rows(table)
        return table


SOURCES: Registry[Source] = Registry("published source", "published_sources", make=Source)


def source_named(name: str) -> Source:
    """Return a registered source, or the one of the user's own CSV file.

    Parameters
    ----------
    name
        Name of a source, or path of a CSV file.

    Raises
    ------
    InputError
        There is no such source or file.
    """
    if not name.lower().endswith(SUFFIX):
        if name not in SOURCES:
            raise InputError(f"no published source '{name}'{among(name, SOURCES.names())}")
        return SOURCES.get(name)
    from puckbench.published_sources.rows import rows_of_file

    path = Path(name)
    return Source(path.stem, lambda: rows_of_file(path), path.stem, str(path), "your own file")


def all_sources() -> list[Source]:
    """Return all registered sources of published numbers, in the order of their names."""
    return [SOURCES.get(name) for name in SOURCES.names()]
