from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError
from puckbench.metrics.statistics import BETTER, BEYOND, NO_VERDICT, NOT_WORSE, WITHIN
from puckbench.tables.odometry_differences import odometry_differences
from puckbench.tables.registry import ODOMETRY, TABLES, UNDECODED

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.tables.odometry_differences",)

NONE_SUFFICES = "no rate suffices"
_KEYS = ["dataset", "odometry", "codec", "times"]
_OF_RATE = ("bits", "rate", "value", "difference", "low", "high")


@TABLES.register(
    "odometry_bits",
    title="Bits that odometry needs",
    needs=(ODOMETRY,),
    shown=(
        *("dataset", "codec", "measure", "unit"),
        *("bits", "undecoded", "difference", "verdict"),
    ),
)
def odometry_bits(drives: pd.DataFrame, margins: Mapping[str, float] | None = None) -> pd.DataFrame:
    """The table shows from how many bits per return on odometry is as good as without coding.

    ``bits`` and ``rate`` are those of the lowest rate that, like all higher ones, is not worse by
    more than the margin; the upper end of the interval decides (see `odometry_differences`). They
    are empty if no rate is good enough, or if there are fewer than 6 trajectories, which allow no
    verdict. But if odometry on the undecoded turns stands for the true poses of these few
    trajectories, the greatest deviation decides, and the verdict is about them only. ``value`` is
    the mean error at this rate, and ``difference`` its mean difference to the same trajectories
    without coding (``undecoded``). ``low`` and ``high`` are the 95 % interval of the difference.
    All are in ``unit``. ``times`` tells whether the codec keeps the firing times, whether they come
    from the azimuths of decoded points, or whether there are none. The results without coding use
    the sensor's own times in all rows.
    """
    import pandas as pd

    differences = odometry_differences(drives, margins)
    coded = differences[differences["codec"] != UNDECODED]
    if coded.empty:
        raise InputError("drives table: no codec's results")
    groups = coded.groupby(_KEYS, sort=False)
    return pd.DataFrame(
        [{**dict(zip(_KEYS, key, strict=True)), **_of_codec(rows)} for key, rows in groups]
    )


def lowest_sufficient(curve: pd.DataFrame, verdicts: Collection[str]) -> pd.Series[Any] | None:
    """Return the row of the lowest rate that, like all higher ones, has one of some verdicts.

    `curve` has a row for each rate, in ascending order of bits. The result is None without such a
    rate.
    """
    suffices = curve["verdict"].isin(verdicts).to_numpy()
    kept = np.flatnonzero(np.logical_and.accumulate(suffices[::-1])[::-1])
    return curve.iloc[kept[0]] if len(kept) else None


def values_at(rate: pd.Series[Any] | None, columns: Iterable[str]) -> dict[str, Any]:
    """Return the values of a row of `lowest_sufficient` in some columns; empty ones if it is None.

    Empty is a text without characters in the column ``rate``, and otherwise nan.
    """
    if rate is None:
        return {name: "" if name == "rate" else np.nan for name in columns}
    return {name: rate[name] for name in columns}


def _of_codec(rows: pd.DataFrame) -> dict[str, Any]:
    curve = rows.sort_values("bits", ignore_index=True)
    first = lowest_sufficient(curve, (BETTER, NOT_WORSE, WITHIN))
    lowest = curve.iloc[0]
    verdict = WITHIN if curve["verdict"].isin([WITHIN, BEYOND]).any() else NOT_WORSE
    if lowest["verdict"] == NO_VERDICT:
        verdict = NO_VERDICT
    elif first is None:
        verdict = NONE_SUFFICES
    return {
        "measure": lowest["measure"],
        "unit": lowest["unit"],
        "trajectories": int(lowest["trajectories"]),
        "undecoded": float(lowest["undecoded"]),
        "margin": float(lowest["margin"]),
        "verdict": verdict,
        **values_at(first, _OF_RATE),
        "poses": lowest["poses"],
    }
