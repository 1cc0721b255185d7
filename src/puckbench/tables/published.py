from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from puckbench.results.columns import Column
from puckbench.tables.registry import PUBLISHED, TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.published_sources.beside",)

_COLUMNS = (
    Column("published_as", "Published data set"),
    Column("origin", "From"),
    Column("frames", "Frames", missing="not stated"),
    Column("resolution", "Coordinates before coding"),
    Column("machine", "Machine"),
    Column("differs", "Differences of conditions", missing="none"),
    Column("measured", "Value"),
    Column("place", "Where it stands"),
)


@TABLES.register(
    "published",
    title="Published numbers beside this run's",
    needs=(PUBLISHED,),
    columns=_COLUMNS,
    shown=("dataset", "metric", "origin", "codec", "rate", "bpp", "measured", "differs"),
)
def published(
    metrics: pd.DataFrame, clouds: pd.DataFrame, datasets: Mapping[str, str]
) -> pd.DataFrame:
    """The table shows the points of this run's curves, and of those that others published.

    The configuration says which published data set a data set is (`published`); whether its clouds
    are the same is not known. Values of this run are means over clouds, or medians where the
    published ones are. ``differs`` names each condition in which a published point differs from
    this run: peak of the PSNR, number of points and frames, coordinates before coding, version of
    the same codec, and the machine for times. Points that differ are on no common curve.
    """
    from puckbench.published_sources.beside import beside_published
    from puckbench.published_sources.registry import all_sources

    return beside_published(metrics, clouds, datasets, all_sources())
