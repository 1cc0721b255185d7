from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING

from pointkit.errors import InputError, among, naming
from puckbench.metrics.lossless import LOSSLESS, lossless_rows
from puckbench.metrics.peaks import PEAK, with_peaks
from puckbench.metrics.statistics import SCENE, with_scenes
from puckbench.report.reference_results import DIGEST, ReferenceResults, check_results
from puckbench.tables.rate_deltas import bd_rate

if TYPE_CHECKING:
    import pandas as pd

_CLOUD = ["dataset", "cloud"]
_NO_QUALITIES = ("bpp", LOSSLESS, PEAK)
_NAMED = 5
"""Largest number of clouds that a message names."""
Key = tuple[str, str]


@dataclass(frozen=True)
class Comparison:
    """Results of a run and of a reference study on the same clouds.

    Parameters
    ----------
    run_rows
        Results of the run, in which data sets and clouds have the names that they have in the
        study.
    reference
        Results of the study on these clouds.
    deltas
        BD-rates, as `bd_rate` returns them, with ``codec`` from the run and ``anchor`` from the
        study.
    left_out
        Clouds of the run that the study lacks, each with the reason.
    same_streams
        For each codec that both have: the number of streams of equal size, and of all streams.
    """

    run_rows: pd.DataFrame
    reference: pd.DataFrame
    deltas: pd.DataFrame
    left_out: tuple[str, ...]
    same_streams: Mapping[str, tuple[int, int]]


def compare_with_reference(
    metrics: pd.DataFrame,
    clouds: pd.DataFrame,
    reference: ReferenceResults,
    codecs: Sequence[str] = (),
    qualities: Sequence[str] = (),
    common: bool = False,
) -> Comparison:
    """Compare codecs of a run with codecs of a reference study on the same clouds.

    Clouds are the same if the digests of their coordinates are equal.

    Parameters
    ----------
    metrics, clouds
        Tables of the run: results, and clouds with their digests.
    reference
        Results of the study.
    codecs
        Codecs of the run to compare; by default, those that the study lacks.
    qualities
        Metrics to compare, as columns of the results. By default, they are the metrics of the
        study's BD-rates that the study has on these clouds.
    common
        Whether to ignore clouds that only the run has; otherwise, such clouds raise InputError.

    Raises
    ------
    InputError
        No cloud is common, a cloud is not in the study and `common` is false, or a codec, rate or
        metric is missing.
    """
    chosen = tuple(dict.fromkeys(qualities))
    check_results(metrics)
    reference_names, left_out = _matched(clouds, reference)
    if not reference_names or (left_out and not common):
        raise InputError(_refused(len(reference_names), left_out, reference.name))
    codec_names = _chosen(metrics, reference, codecs)
    run_rows = _renamed(metrics[metrics["codec"].isin(codec_names)], reference_names)
    if run_rows.empty:
        raise InputError(
            f"no results of {', '.join(codec_names)} on the clouds of {reference.name}"
        )
    common_clouds = set(zip(run_rows["dataset"], run_rows["cloud"], strict=True))
    published = reference.metrics
    keys = zip(published["dataset"], published["cloud"], strict=True)
    reference_rows = published[[key in common_clouds for key in keys]]
    of_study = reference.bd_rate["qualities"]
    measured = [q for q in of_study if q in reference_rows and reference_rows[q].notna().any()]
    qualities = chosen or tuple(measured) or of_study
    _check_qualities(run_rows, reference_rows, qualities, reference.name)
    _check_rates(run_rows, reference_rows, qualities)
    deltas = _deltas(run_rows, reference_rows, qualities, reference)
    same_streams = _same_streams(metrics, reference_names, reference_rows)
    return Comparison(run_rows, reference_rows, deltas, tuple(left_out), same_streams)


def _matched(clouds: pd.DataFrame, reference: ReferenceResults) -> tuple[dict[Key, Key], list[str]]:
    from pointkit.tables import check_columns

    if DIGEST not in clouds or clouds[DIGEST].isna().any():
        raise InputError("the table of clouds has no digests: it is of an older run; run it again")
    with naming("the table of clouds"):
        check_columns(clouds, [*_CLOUD, DIGEST])
    published = reference.clouds
    rows = reference.metrics[[*_CLOUD, DIGEST]].drop_duplicates()
    digests = {(str(s), str(c)): str(d) for s, c, d in rows.itertuples(index=False)}
    reference_names: dict[Key, Key] = {}
    left_out = []
    for dataset, cloud, digest in clouds[[*_CLOUD, DIGEST]].itertuples(index=False):
        key = (str(dataset), str(cloud))
        if digests.get(key) == digest:
            reference_names[key] = key
        elif digest in published:
            reference_names[key] = published[str(digest)]
        else:
            reason = "other points" if key in digests else "unknown there"
            left_out.append(f"{'/'.join(key)} ({reason})")
    return reference_names, left_out


def _refused(common: int, left_out: Sequence[str], study: str) -> str:
    named = ", ".join(left_out[:_NAMED])
    more = f" and {len(left_out) - _NAMED} more" if len(left_out) > _NAMED else ""
    line = f"not the clouds of {study}, by their digests: {named}{more}"
    if not common:
        return f"{line}; no other is left to compare"
    return f"{line}; --common compares the other {common}"


def _chosen(metrics: pd.DataFrame, reference: ReferenceResults, codecs: Sequence[str]) -> list[str]:
    run_codecs = list(dict.fromkeys(metrics["codec"]))
    for codec in codecs:
        if codec not in run_codecs:
            raise InputError(f"the run has no codec {codec!r}{among(codec, run_codecs)}")
    published = set(reference.metrics["codec"])
    return list(codecs) or [codec for codec in run_codecs if codec not in published] or run_codecs


def _renamed(metrics: pd.DataFrame, reference_names: Mapping[Key, Key]) -> pd.DataFrame:
    keys = list(zip(metrics["dataset"], metrics["cloud"], strict=True))
    rows = metrics[[key in reference_names for key in keys]]
    new_names = [reference_names[key] for key in keys if key in reference_names]
    return rows.assign(dataset=[key[0] for key in new_names], cloud=[key[1] for key in new_names])


def _check_qualities(
    run_rows: pd.DataFrame, reference_rows: pd.DataFrame, qualities: Sequence[str], study: str
) -> None:
    from pointkit.tables import is_number_column

    for whose, table in (("the run", run_rows), (study, reference_rows)):
        for quality in qualities:
            if (
                quality not in table
                or quality in _NO_QUALITIES
                or not is_number_column(table[quality])
                or table[quality].isna().all()
            ):
                raise InputError(f"{whose} has no metric {quality!r} on these clouds")


def _check_rates(
    run_rows: pd.DataFrame, reference_rows: pd.DataFrame, qualities: Sequence[str]
) -> None:
    for (dataset, codec), rows in run_rows.groupby(["dataset", "codec"], sort=False):
        rates = list(dict.fromkeys(rows["rate"]))
        if len(rates) == 1:
            raise InputError(f"codec {codec!r}: only the rate {rates[0]} on {dataset}: no curve")
        for cloud in dict.fromkeys(run_rows.loc[run_rows["dataset"] == dataset, "cloud"]):
            of_cloud = rows[rows["cloud"] == cloud].set_index("rate")
            for rate in rates:
                if rate not in of_cloud.index:
                    raise InputError(f"codec {codec!r}: no result of {dataset}/{cloud} at {rate}")
            for quality in qualities:
                if dataset not in _measured(reference_rows, quality):
                    continue
                missing = of_cloud[of_cloud[quality].isna() & ~_is_exact(of_cloud, quality)]
                if len(missing):
                    where = f"{dataset}/{cloud} at {missing.index[0]}"
                    raise InputError(f"codec {codec!r}: no {quality} of {where}")


def _is_exact(rows: pd.DataFrame, quality: str) -> pd.Series[bool]:
    error = quality.replace("_psnr", "_mse")
    return rows[error] == 0 if error != quality and error in rows else rows[quality] == 0


def _deltas(
    run_rows: pd.DataFrame,
    reference_rows: pd.DataFrame,
    qualities: Sequence[str],
    reference: ReferenceResults,
) -> pd.DataFrame:
    import pandas as pd

    margin = reference.bd_rate["margin_percent"]
    tables = []
    run_rows, reference_rows = (_judged(table) for table in (run_rows, reference_rows))
    reference_rows = with_scenes(reference_rows)
    scenes = reference_rows[[*_CLOUD, SCENE]].drop_duplicates()
    run_rows = run_rows.drop(columns=SCENE, errors="ignore").merge(scenes, on=_CLOUD)
    columns = [*_CLOUD, SCENE, "codec", "rate", "bpp", LOSSLESS, PEAK, *qualities]
    for codec in reference.style.ordered_codecs(reference_rows["codec"]):
        anchor = f"{codec} ({reference.name})"  # no codec's name has parentheses
        rows = reference_rows.loc[reference_rows["codec"] == codec, columns].assign(codec=anchor)
        both = run_rows.loc[run_rows["dataset"].isin(set(rows["dataset"])), columns]
        shared = [name for name in qualities if _measured(both, name) & _measured(rows, name)]
        if shared:
            table = bd_rate(pd.concat([both, rows]), anchor, shared, margin)
            tables.append(table.assign(anchor=codec))
    if not tables:
        raise InputError(f"{reference.name} has no codec with curves on these clouds")
    return pd.concat(tables, ignore_index=True)


def _judged(rows: pd.DataFrame) -> pd.DataFrame:
    table = with_peaks(rows).assign(**{LOSSLESS: lossless_rows(rows)})
    return table if PEAK in table else table.assign(**{PEAK: nan})


def _measured(rows: pd.DataFrame, quality: str) -> set[str]:
    return set(rows.loc[rows[quality].notna(), "dataset"])


def _same_streams(
    metrics: pd.DataFrame, reference_names: Mapping[Key, Key], reference_rows: pd.DataFrame
) -> dict[str, tuple[int, int]]:
    keys = [*_CLOUD, "codec", "rate"]
    pairs = _renamed(metrics, reference_names)[[*keys, "bytes"]].merge(
        reference_rows[[*keys, "bytes"]], on=keys
    )
    same = pairs["bytes_x"] == pairs["bytes_y"]
    return {
        str(codec): (int(part.sum()), len(part))
        for codec, part in same.groupby(pairs["codec"], sort=False)
    }
