from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.metrics.lossless import LOSSLESS, lossless_rows, with_lossless_best, without_lossless
from puckbench.metrics.peaks import PEAK, with_peaks, without_mixed_peaks
from puckbench.metrics.statistics import MIN_SCENES
from puckbench.results.columns import FRAME, SPREAD, declared_among
from puckbench.tables.registry import TABLES

if TYPE_CHECKING:
    import pandas as pd


@TABLES.register(
    "summary",
    title="Medians per data set, codec and rate",
    shown=("dataset", "codec", "rate", "bpp", "d1_psnr", "d2_psnr", "encode_s", "decode_s"),
)
def summary(metrics: pd.DataFrame) -> pd.DataFrame:
    """Medians over the clouds of each data set, codec and rate, and their spread.

    Columns: medians, quartiles (``_q25``, ``_q75``) if there are six clouds or more, and the number
    of clouds. ``lossless`` is the number of clouds that are decoded with rounding errors only. They
    have no PSNR; for medians, their PSNR counts as the highest. PSNRs have no median if the peaks
    (``peak``) of the clouds differ.
    """
    import pandas as pd

    keys = ["dataset", "codec", "rate"]
    table = with_lossless_best(without_mixed_peaks(with_peaks(metrics)))
    groups = table.groupby(keys, sort=False)
    numbers = [each.name for each in declared_among(metrics) if each.summarised]
    shares = [
        groups[numbers].quantile(share).where(groups.size() >= MIN_SCENES).add_suffix(f"_{name}")
        for name, share in SPREAD.items()
    ]
    medians = groups[numbers].median().assign(clouds=groups.size())
    lossless = table.assign(**{LOSSLESS: lossless_rows(metrics)}).groupby(keys, sort=False)
    medians[LOSSLESS] = lossless[LOSSLESS].sum()
    for name in ("weights", PEAK, FRAME):
        if name in table:
            medians[name] = groups[name].first()
    return without_lossless(pd.concat([medians, *shares], axis=1)).reset_index()
