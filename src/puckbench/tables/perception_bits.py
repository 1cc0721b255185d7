from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from puckbench.metrics.statistics import BETTER, NO_VERDICT, NOT_WORSE
from puckbench.tables.odometry_bits import NONE_SUFFICES, lowest_sufficient, values_at
from puckbench.tables.perception_losses import perception_losses
from puckbench.tables.registry import PERCEPTION, TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.tables.odometry_bits", "puckbench.tables.perception_losses")

_KEYS = ["task", "codec", "dataset"]
_OF_RATE = ("bits", "rate", "value", "loss", "low", "high")


@TABLES.register(
    "perception_bits",
    title="Bits per return that a task needs",
    needs=(PERCEPTION,),
    shown=("task_title", "codec", "dataset", "bits", "rate", "undecoded", "loss", "verdict"),
)
def perception_bits(
    metrics: pd.DataFrame | None = None,
    drives: pd.DataFrame | None = None,
    clouds: pd.DataFrame | None = None,
    measures: Sequence[Mapping[str, Any]] | None = None,
    along_rays: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The table shows from how many bits per return on a task is as good as without coding.

    ``bits`` and ``rate`` are those of the lowest rate that, like all higher ones, is not worse by
    more than the margin; the upper end of the interval of the loss decides (see
    `perception_losses`). They are empty if no rate is good enough, or if there are fewer than 6
    scenes, which allow no verdict. ``value`` is the mean result at this rate, and ``loss`` with its
    95 % interval (``low`` and ``high``) the mean loss to the same scans without coding
    (``undecoded``). ``most_bits`` are those of the highest rate that was measured.
    """
    return bits_needed(perception_losses(metrics, drives, clouds, measures, along_rays))


def bits_needed(losses: pd.DataFrame) -> pd.DataFrame:
    """Return the table `perception_bits` that follows from a table `perception_losses`."""
    import pandas as pd

    groups = losses.groupby(_KEYS, sort=False)
    return pd.DataFrame(
        [{**dict(zip(_KEYS, key, strict=True)), **_of_curve(rows)} for key, rows in groups]
    )


def _of_curve(rows: pd.DataFrame) -> dict[str, Any]:
    curve = rows.sort_values("bits", ignore_index=True)
    first = lowest_sufficient(curve, (BETTER, NOT_WORSE))
    lowest = curve.iloc[0]
    verdict = NOT_WORSE if first is not None else NONE_SUFFICES
    if (curve["verdict"] == NO_VERDICT).all():
        verdict = NO_VERDICT
    return {
        "task_title": lowest["task_title"],
        "sensor": lowest["sensor"],
        "along_rays": bool(lowest["along_rays"]),
        "unit": lowest["unit"],
        "scenes": int(lowest["scenes"]),
        "undecoded": float(lowest["undecoded"]),
        "margin": float(lowest["margin"]),
        "verdict": verdict,
        **values_at(first, _OF_RATE),
        "most_bits": float(curve["bits"].iloc[-1]),
    }
