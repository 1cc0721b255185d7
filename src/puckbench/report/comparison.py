"""One's own results beside reference results on the same clouds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING

from puckbench.core.errors import InputError
from puckbench.core.models import among
from puckbench.metrics.bjontegaard import MIN_POINTS
from puckbench.metrics.lossless import LOSSLESS, lossless_rows
from puckbench.metrics.peaks import PEAK, with_peaks
from puckbench.metrics.tables.rate_deltas import bd_rate
from puckbench.report.reference_results import DIGEST, ReferenceResults

if TYPE_CHECKING:
    import pandas as pd

_CLOUD = ["dataset", "cloud"]
_NAMED = 5
"""Clouds that a message names at most."""
Key = tuple[str, str]


@dataclass(frozen=True)
class Comparison:
    """Results of two sources on the same clouds.

    Parameters
    ----------
    own
        Result rows of one's own codecs, under the reference's names of data sets and clouds.
    reference
        Reference results on these clouds.
    deltas
        As `puckbench.metrics.tables.rate_deltas.bd_rate`: own ``codec`` against reference codec
        ``anchor``.
    left_out
        Own clouds that were not compared, each with the reason.
    same_streams
        Codec that both have -> how many streams have as many bytes, of how many.
    """

    own: pd.DataFrame
    reference: pd.DataFrame
    deltas: pd.DataFrame
    left_out: tuple[str, ...]
    same_streams: Mapping[str, tuple[int, int]]


def compared(
    metrics: pd.DataFrame,
    clouds: pd.DataFrame,
    reference: ReferenceResults,
    codecs: Sequence[str] = (),
    qualities: Sequence[str] = (),
    common: bool = False,
) -> Comparison:
    """Compare codecs of a run with those of reference results, on the same clouds.

    Parameters
    ----------
    metrics, clouds
        The run's tables of those names.
    reference
        What to compare with.
    codecs
        Of the run; by default those that the reference does not have, or all where it has all.
    qualities
        Columns of results; by default those of the reference's own deltas.
    common
        Whether to compare the common clouds where the run has others too.

    Raises
    ------
    InputError
        A cloud is not the reference's and `common` is false; or there is no common cloud; or a
        codec, rate or metric is missing.
    """
    qualities = tuple(qualities or reference.bd_rate["qualities"])
    names, left_out = _matched(clouds, reference)
    if not names or (left_out and not common):
        raise InputError(_refused(len(names), left_out, reference.name))
    chosen = _chosen(metrics, reference, codecs)
    own = _renamed(metrics[metrics["codec"].isin(chosen)], names)
    if own.empty:
        raise InputError(f"no results of {', '.join(chosen)} on the clouds of {reference.name}")
    known = set(zip(own["dataset"], own["cloud"], strict=True))
    theirs = reference.metrics
    theirs = theirs[[key in known for key in zip(theirs["dataset"], theirs["cloud"], strict=True)]]
    _check_qualities(own, theirs, qualities, reference.name)
    _check_rates(own, theirs, qualities)
    deltas = _deltas(own, theirs, qualities, reference)
    return Comparison(own, theirs, deltas, tuple(left_out), _same_streams(metrics, names, theirs))


def _matched(clouds: pd.DataFrame, reference: ReferenceResults) -> tuple[dict[Key, Key], list[str]]:
    """Own clouds -> the reference's names of the same points; the others, with the reason."""
    if DIGEST not in clouds or clouds[DIGEST].isna().any():
        raise InputError("the table of clouds has no digests: it is of an older run; run it again")
    published = reference.clouds
    rows = reference.metrics[[*_CLOUD, DIGEST]].drop_duplicates()
    known = {(str(s), str(c)): str(d) for s, c, d in rows.itertuples(index=False)}
    names: dict[Key, Key] = {}
    left_out = []
    for dataset, cloud, digest in clouds[[*_CLOUD, DIGEST]].itertuples(index=False):
        key = (str(dataset), str(cloud))
        if known.get(key) == digest:
            names[key] = key
        elif digest in published:
            names[key] = published[str(digest)]
        else:
            reason = "other points" if key in known else "unknown there"
            left_out.append(f"{'/'.join(key)} ({reason})")
    return names, left_out


def _refused(common: int, left_out: Sequence[str], study: str) -> str:
    named = ", ".join(left_out[:_NAMED])
    more = f" and {len(left_out) - _NAMED} more" if len(left_out) > _NAMED else ""
    line = f"not the clouds of {study}, by their digests: {named}{more}"
    if not common:
        return f"{line}; no other is left to compare"
    return f"{line}; --common compares the other {common}"


def _chosen(metrics: pd.DataFrame, reference: ReferenceResults, codecs: Sequence[str]) -> list[str]:
    there = list(dict.fromkeys(metrics["codec"]))
    for codec in codecs:
        if codec not in there:
            raise InputError(f"the run has no codec {codec!r}{among(codec, there)}")
    published = set(reference.metrics["codec"])
    return list(codecs) or [codec for codec in there if codec not in published] or there


def _renamed(metrics: pd.DataFrame, names: Mapping[Key, Key]) -> pd.DataFrame:
    """The rows of matched clouds, under the reference's names of these."""
    keys = list(zip(metrics["dataset"], metrics["cloud"], strict=True))
    rows = metrics[[key in names for key in keys]]
    found = [names[key] for key in keys if key in names]
    return rows.assign(dataset=[key[0] for key in found], cloud=[key[1] for key in found])


def _check_qualities(
    own: pd.DataFrame, theirs: pd.DataFrame, qualities: Sequence[str], study: str
) -> None:
    for whose, table in (("the run", own), (study, theirs)):
        for quality in qualities:
            if quality not in table or table[quality].isna().all():
                raise InputError(f"{whose} has no metric {quality!r} on these clouds")


def _check_rates(own: pd.DataFrame, theirs: pd.DataFrame, qualities: Sequence[str]) -> None:
    """InputError for a codec that lacks a rate, or a value of it, on a cloud of a data set."""
    for (dataset, codec), rows in own.groupby(["dataset", "codec"], sort=False):
        rates = list(dict.fromkeys(rows["rate"]))
        if len(rates) < MIN_POINTS:
            raise InputError(f"codec {codec!r}: only the rate {rates[0]} on {dataset}: no curve")
        for cloud in dict.fromkeys(own.loc[own["dataset"] == dataset, "cloud"]):
            of_cloud = rows[rows["cloud"] == cloud].set_index("rate")
            for rate in rates:
                if rate not in of_cloud.index:
                    raise InputError(f"codec {codec!r}: no result of {dataset}/{cloud} at {rate}")
            for quality in qualities:
                if not theirs.loc[theirs["dataset"] == dataset, quality].notna().any():
                    continue
                lacks = of_cloud[of_cloud[quality].isna() & ~_is_exact(of_cloud, quality)]
                if len(lacks):
                    where = f"{dataset}/{cloud} at {lacks.index[0]}"
                    raise InputError(f"codec {codec!r}: no {quality} of {where}")


def _is_exact(rows: pd.DataFrame, quality: str) -> pd.Series[bool]:
    """Where there is no error, of which no PSNR can be told."""
    error = quality.replace("_psnr", "_mse")
    return rows[error] == 0 if error != quality and error in rows else rows[quality] == 0


def _deltas(
    own: pd.DataFrame,
    theirs: pd.DataFrame,
    qualities: Sequence[str],
    reference: ReferenceResults,
) -> pd.DataFrame:
    """Own codecs against each one of the reference, by data set and quality."""
    import pandas as pd

    options = {k: v for k, v in reference.bd_rate.items() if k in ("resamples", "seed")}
    found = []
    own, theirs = (_judged(table) for table in (own, theirs))
    columns = ["dataset", "cloud", "codec", "rate", "bpp", LOSSLESS, PEAK, *qualities]
    for codec in reference.style.ordered_codecs(theirs["codec"]):
        anchor = f"{codec} ({reference.name})"  # no codec's name has brackets
        rows = theirs.loc[theirs["codec"] == codec, columns].assign(codec=anchor)
        both = own.loc[own["dataset"].isin(set(rows["dataset"])), columns]
        for part in _with_values(both, rows, qualities):
            table = bd_rate(pd.concat([part[0], part[1]]), anchor, part[2], **options)
            found.append(table.assign(anchor=codec))
    if not found:
        raise InputError(f"{reference.name} has no codec with curves on these clouds")
    return pd.concat(found, ignore_index=True)


def _judged(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the columns that rates and PSNRs are judged by, also those of older runs."""
    table = with_peaks(rows).assign(**{LOSSLESS: lossless_rows(rows)})
    return table if PEAK in table else table.assign(**{PEAK: nan})


def _with_values(
    own: pd.DataFrame, theirs: pd.DataFrame, qualities: Sequence[str]
) -> Iterator[tuple[pd.DataFrame, pd.DataFrame, list[str]]]:
    """Both tables with the qualities that both have, if there are any on a common data set."""
    names = [
        name
        for name in qualities
        if set(own.loc[own[name].notna(), "dataset"])
        & set(theirs.loc[theirs[name].notna(), "dataset"])
    ]
    if names:
        yield own, theirs, names


def _same_streams(
    metrics: pd.DataFrame, names: Mapping[Key, Key], theirs: pd.DataFrame
) -> dict[str, tuple[int, int]]:
    """Codecs of both: how many of the streams of equal clouds and rates have as many bytes."""
    keys = [*_CLOUD, "codec", "rate"]
    both = _renamed(metrics, names)[[*keys, "bytes"]].merge(theirs[[*keys, "bytes"]], on=keys)
    same = both["bytes_x"] == both["bytes_y"]
    return {
        str(codec): (int(part.sum()), len(part))
        for codec, part in same.groupby(both["codec"], sort=False)
    }
