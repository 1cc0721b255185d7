from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.metrics.lossless import lossless_rows
from puckbench.metrics.statistics import SCENE, Estimate, means_over_seeds
from puckbench.results.columns import LOWER, Column
from puckbench.tables.against_octree import COMPLETE_OCTREE
from puckbench.tables.rate_deltas import MARGIN_PERCENT, percent_columns
from puckbench.tables.registry import SEVERAL_CODECS, TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.tables.against_octree", "puckbench.tables.rate_deltas")

_COLUMNS = (
    *("dataset", "codec", "anchor", "bpp"),
    *("lossless_percent", "lossless_percent_low", "lossless_percent_high"),
    *("lossless_percent_least", "lossless_percent_most", "verdict", "scenes", "clouds"),
)
_MISSING = "the anchor, or no cloud that both code without loss"


@TABLES.register(
    "lossless_bits",
    title="Bits without loss",
    needs=(SEVERAL_CODECS,),
    columns=[
        Column("lossless_percent", "Bits without loss", "%", LOWER, missing=_MISSING, decimals=1)
    ],
    shown=("dataset", "codec", "anchor", "bpp", "lossless_percent", "verdict", "scenes"),
)
def lossless_bits(
    metrics: pd.DataFrame, anchor: str, margin_percent: float = MARGIN_PERCENT
) -> pd.DataFrame:
    """The table compares the bits per point of codecs at rates without loss, and at no others.

    At such a rate, all points come back, but for rounding errors. If a codec has several, the one
    with the fewest bits counts on each cloud. ``bpp`` is the bits per point, and
    ``lossless_percent`` the difference to those of the ``anchor`` on the same clouds in percent
    (negative: fewer bits). Both are geometric means over the seeds of a scene, then over scenes.
    Attributes are not counted if the codec tells their bits.

    If the run's anchor codes fewer clouds of a data set without loss than another codec does, the
    anchor of this data set is ``gpcc_lossless`` or else the codec with the most clouds. Intervals
    and verdicts are those of ``bd_rate``.
    """
    import pandas as pd

    rows = metrics[lossless_rows(metrics) & _is_complete(metrics)]
    bits = rows.reindex(columns=["bpp_geometry"])["bpp_geometry"].fillna(rows["bpp"])
    rows = rows.assign(log_bits=np.log(bits.astype(float)))
    table = [
        row
        for _, part in rows.groupby("dataset", sort=False)
        for row in _of_data_set(part, anchor, margin_percent)
    ]
    return pd.DataFrame(table, columns=list(_COLUMNS))


def _is_complete(metrics: pd.DataFrame) -> Any:
    """Return a mask of rows in which as many points come back as went in, as far as is known."""
    counts = metrics.reindex(columns=["points_in", "points_out"])
    return counts["points_in"].eq(counts["points_out"]) | counts.isna().any(axis=1)


def _of_data_set(
    rows: pd.DataFrame, anchor: str, margin_percent: float
) -> Iterator[dict[str, Any]]:
    fewest = rows.sort_values("log_bits").drop_duplicates(["codec", "cloud"])
    clouds = rows.groupby("codec", sort=False)["cloud"].nunique()
    preferred = [name for name in (anchor, COMPLETE_OCTREE) if name in clouds]
    base = max([*preferred, *clouds.index], key=lambda name: clouds[name])
    of_base = fewest[fewest["codec"] == base].set_index("cloud")["log_bits"]
    fewest = fewest.assign(log_ratio=fewest["log_bits"] - fewest["cloud"].map(of_base))
    scenes = means_over_seeds(fewest, ["codec"], ["log_bits", "log_ratio"])
    for codec in scenes.groupby("codec")["log_bits"].mean().sort_values().index:
        of_codec = scenes[scenes["codec"] == codec]
        row = {
            "dataset": rows["dataset"].iloc[0],
            "codec": codec,
            "anchor": base,
            "bpp": float(np.exp(of_codec["log_bits"].mean())),
            "scenes": of_codec[SCENE].nunique(),
            "clouds": clouds[codec],
        }
        if codec != base:
            ratio = Estimate.of(of_codec["log_ratio"])
            row |= percent_columns("lossless_percent", ratio, margin_percent)
        yield row
