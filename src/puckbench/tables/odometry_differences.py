from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError
from puckbench.metrics.statistics import (
    BEYOND,
    NO_VERDICT,
    SCENE,
    UNDECIDED,
    WITHIN,
    Estimate,
    means_over_seeds,
)
from puckbench.metrics.tasks.odometry import GICP
from puckbench.recordings.drives import KEPT, UNDECODED_POSES
from puckbench.tables.odometry_margins import OdometryMargins
from puckbench.tables.registry import ODOMETRY, TABLES, UNDECODED

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.metrics.tasks.odometry", "puckbench.tables.odometry_margins")

ALL = "all"
"""Value of ``dataset`` for the trajectories of all data sets with the same measure."""
ODOMETRIES = {"KISS-ICP": "", "GICP": GICP}
"""Names of the odometries, and the prefix of their columns."""


@dataclass(frozen=True)
class Measure:
    """An error of odometry that the table compares.

    Parameters
    ----------
    name, unit
        Name and unit in the table.
    column, factor
        Column of the results, and the factor that converts it to the unit.
    margin, deviation_margin
        Names of the `OdometryMargins` for true poses, and for those of odometry without coding.
    """

    name: str
    column: str
    factor: float
    unit: str
    margin: str
    deviation_margin: str

    def margin_of(self, margins: OdometryMargins, undecoded: float, is_deviation: bool) -> float:
        """Return the largest difference that counts as none.

        Parameters
        ----------
        margins
            Margins of all measures.
        undecoded
            Mean error without coding.
        is_deviation
            Whether odometry without coding stands for the true poses.
        """
        margin = getattr(margins, self.deviation_margin if is_deviation else self.margin)
        return max(float(margin), margins.relative * undecoded)


MEASURES = (
    Measure("drift", "drift_percent", 1.0, "%", "drift_percent", "deviation_drift_percent"),
    Measure("absolute error", "ate_m", 1000.0, "mm", "absolute_mm", "deviation_mm"),
)
"""The first measure that all drives of a data set have is shown."""
_KEYS = ["odometry", "codec", "times", "rate"]
_DIGITS = 6
"""Decimals of differences, in % and mm: smaller ones are those of sums in another order."""


@TABLES.register(
    "odometry_differences",
    title="Odometry after decoding, against before",
    needs=(ODOMETRY,),
    columns={"least": "Least difference", "most": "Greatest difference"},
    shown=(
        *("dataset", "codec", "rate", "measure", "unit"),
        *("undecoded", "difference", "verdict"),
    ),
)
def odometry_differences(
    drives: pd.DataFrame, margins: Mapping[str, float] | None = None
) -> pd.DataFrame:
    """The table shows how much coding changes the errors of odometry on the same trajectory.

    ``measure`` and ``unit`` are the drift in % of the way (mean over 10, 20 and 50 m), or the
    absolute error of positions in mm if a drive of the data set is too short for a drift.
    ``undecoded`` is the mean error over trajectories without coding, with the sensor's firing times
    where there are any. All rows are compared with it. ``value`` is the mean error with coding,
    with the firing times that ``times`` names.

    ``difference`` is the mean of the differences of trajectories. For 6 or more trajectories,
    ``low`` and ``high`` are its 95 % interval by Student's t. ``least`` and ``most`` are the
    extreme differences. ``margin`` is fixed before the measurement (``odometry_margins`` in the
    configuration): by default 0.1 % or 10 mm, or a tenth of ``undecoded`` if that is more.
    ``verdict`` is ``better`` if the interval is below 0, ``not worse`` if it is below the margin,
    ``worse`` if it is above 0, and otherwise ``undecided``. It is ``no verdict`` for fewer than 6
    trajectories.

    ``lost_turns`` is the number of turns, of all ``turns``, whose motion was not found. ``poses``
    tells whether the true poses are known. If not, those of KISS-ICP on the undecoded turns replace
    them, and values are deviations from that trajectory. Their margin is 0.5 % or 50 mm. The
    verdict on fewer than 6 trajectories then is about these only: ``within the margin`` if the
    greatest difference is, otherwise ``beyond the margin``. The data set ``all`` has the
    trajectories of all data sets with a drift.
    """
    import pandas as pd

    rows = errors_of_drives(drives)
    shown = [*rows["dataset"].unique()]
    pooled = rows[rows["measure"] == MEASURES[0].name]
    if pooled["dataset"].nunique() > 1:
        rows, shown = pd.concat([rows, pooled.assign(dataset=ALL)]), [*shown, ALL]
    results = [
        row
        for dataset in shown
        for _, part in rows[rows["dataset"] == dataset].groupby("odometry", sort=False)
        for row in _of_dataset(part, OdometryMargins(**margins or {}))
    ]
    if not results:
        raise InputError("drives table: no codec's results and those of the undecoded drives")
    return pd.DataFrame(results)


def errors_of_drives(drives: pd.DataFrame) -> pd.DataFrame:
    """Return the error of each drive, codec, rate, kind of times and odometry, one in each row.

    Column ``value`` is the error in the unit of the data set's measure. Column ``undecoded`` is the
    error of the same drive without coding.

    Parameters
    ----------
    drives
        Results of tasks: a row for each drive, codec and rate, and rows of drives without coding.
    """
    import pandas as pd

    parts = []
    for dataset in drives["dataset"].unique():
        rows = drives[drives["dataset"] == dataset]
        for odometry, prefix in ODOMETRIES.items():
            measure = _measure_of(rows, prefix)
            if measure is not None:
                part = rows.assign(
                    odometry=odometry,
                    measure=measure.name,
                    value=measure.factor * rows[prefix + measure.column].astype(float),
                    lost=rows[f"{prefix}lost_turns"].astype(float),
                )
                parts.append(_with_baseline(part))
    if not parts:
        raise InputError("drives table: no results of odometry")
    return pd.concat(parts, ignore_index=True)


def _measure_of(rows: pd.DataFrame, prefix: str) -> Measure | None:
    for measure in MEASURES:
        column = prefix + measure.column
        if column in rows and rows[column].notna().all():
            return measure
    return None


def _with_baseline(rows: pd.DataFrame) -> pd.DataFrame:
    undecoded = rows[rows["codec"] == UNDECODED]
    kept = undecoded[undecoded["times"] == KEPT]
    baseline = (kept if len(kept) else undecoded).set_index("cloud")["value"]
    if not set(rows["cloud"]) <= set(baseline.index):
        raise InputError("drives table: no result of an undecoded drive")
    return rows.assign(
        undecoded=rows["cloud"].map(baseline), baseline=KEPT if len(kept) else "none"
    )


def _of_dataset(rows: pd.DataFrame, margins: OdometryMargins) -> Iterator[dict[str, Any]]:
    rows = rows.assign(difference=(rows["value"] - rows["undecoded"]).round(_DIGITS))
    first = rows.iloc[0]
    measure = next(each for each in MEASURES if each.name == first["measure"])
    sources = set(rows["poses"]) if "poses" in rows else set()
    is_deviation = sources == {UNDECODED_POSES}
    numbers = ["value", "undecoded", "difference", "bpp", "lost", "turns"]
    means = means_over_seeds(rows, _KEYS, numbers)
    trajectories = means[SCENE].nunique()
    for key, group in means.groupby(_KEYS, sort=False):
        named = dict(zip(_KEYS, key, strict=True))
        is_baseline = named["codec"] == UNDECODED and named["times"] == first["baseline"]
        if is_baseline:
            continue
        difference = Estimate.of(group["difference"])
        undecoded = float(group["undecoded"].mean())
        margin = measure.margin_of(margins, undecoded, is_deviation)
        verdict = difference.verdict(margin) if len(group) == trajectories else UNDECIDED
        if is_deviation and verdict == NO_VERDICT:
            verdict = WITHIN if difference.most < margin else BEYOND
        yield {
            "dataset": first["dataset"],
            **named,
            "measure": measure.name,
            "unit": measure.unit,
            "bits": float(group["bpp"].mean()),
            "trajectories": len(group),
            "undecoded": undecoded,
            "value": float(group["value"].mean()),
            "difference": difference.mean,
            "low": difference.low,
            "high": difference.high,
            "least": difference.least,
            "most": difference.most,
            "margin": margin,
            "verdict": verdict,
            "lost_turns": int(np.ceil(group["lost"].sum())),
            "turns": int(group["turns"].sum()),
            "poses": ", ".join(sorted(sources)),
        }
