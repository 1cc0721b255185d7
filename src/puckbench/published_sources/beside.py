"""The results of a run beside published numbers of the same data sets, and how conditions differ.

Published clouds are known by name only, so the user says which published data set a data set of the
run is. The values of the run are put together like the published ones: as means or medians over
clouds, or of the cloud with the same name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import inf, isnan, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError, among
from puckbench.metrics.bjontegaard import bjontegaard_delta, rate_distortion_curve
from puckbench.metrics.lossless import lossless_rows
from puckbench.metrics.peaks import peaks_of_datasets, with_peaks, without_mixed_peaks
from puckbench.published_sources.registry import Source
from puckbench.published_sources.rows import (
    BD_RATES,
    COUNTERPARTS,
    MEAN,
    MEASURES,
    MEDIAN,
    NONE,
    NOT_STATED,
    PSNRS,
    TIMES,
)
from puckbench.results.columns import FRAME

if TYPE_CHECKING:
    import pandas as pd

CODE = (
    *("puckbench.metrics.bjontegaard", "puckbench.metrics.lossless", "puckbench.metrics.peaks"),
    *("puckbench.published_sources.*", "puckbench.results.columns"),
)

HERE = "this run"
"""Value of the column ``origin`` for the rows of the run."""
CURVE = [
    *("dataset", "published_as", "metric", "origin", "cloud", "codec", "codec_version"),
    *("peak", "points", "frames", "resolution", "machine", "differs"),
]
"""Columns whose values together tell a curve. Points that differ in one of them, such as the peak,
belong to different curves, so that no line joins points under different conditions."""
_POINT = ("rate", "bpp", "measured")
_ATTRIBUTES = {"y_psnr": "colour", "reflectance_psnr": "reflectance"}
"""What a metric of an attribute compares, as in the names of the columns of bits."""
_PROCESSORS = {"encode_s": "encode_cpu", "decode_s": "cpu"}
_ALIKE = 1.01
"""Largest ratio of two mean numbers of points that count as equal."""


def published_names(sources: Iterable[Source]) -> list[str]:
    """Return the names of the data sets of which sources have numbers."""
    return sorted({name for source in sources for name in source.rows["dataset"]})


def beside_published(
    metrics: pd.DataFrame,
    clouds: pd.DataFrame,
    datasets: Mapping[str, str],
    sources: Sequence[Source],
    measures: Sequence[str] = (),
) -> pd.DataFrame:
    """Return the points of a run's curves, and of the published curves of the same data sets.

    Parameters
    ----------
    metrics, clouds
        Tables of the run: its results, and its clouds with their numbers of points.
    datasets
        Name of the published data set for each data set of the run that is compared.
    sources
        Sources of published numbers.
    measures
        Columns of the results to compare; by default, all that the run and a source have.

    Returns
    -------
    pandas.DataFrame
        A row for each point: ``dataset`` (of the run), ``published_as``, ``metric``, ``origin``
        (`HERE` or the title of a source), ``cloud``, ``codec``, ``codec_version``, its conditions
        (``peak``, ``points``, ``frames``, ``resolution``, ``machine``), ``differs`` (in which
        conditions a published point differs from the run; empty if in none), ``rate``, ``bpp``,
        ``measured`` (the value; infinite for a PSNR without loss) and ``place``.

    Raises
    ------
    InputError
        A data set is unknown, or the run has no measure that was published of it.
    """
    import pandas as pd

    theirs = pd.concat([_rows_of(source) for source in sources], ignore_index=True)
    own_names = list(dict.fromkeys(metrics["dataset"]))
    names = sorted(set(theirs["published_as"]))
    tables = []
    for dataset, name in datasets.items():
        if dataset not in own_names:
            raise InputError(f"the run has no data set '{dataset}'{among(dataset, own_names)}")
        if name not in names:
            raise InputError(f"no published data set '{name}'{among(name, names)}")
        own = _prepared(metrics[metrics["dataset"] == dataset], clouds)
        compared = [each for each in measures or MEASURES if _has(own, each)]
        part = theirs[(theirs["published_as"] == name) & theirs["metric"].isin(compared)]
        if part.empty:
            raise InputError(f"{dataset}: no measure of the run was published of {name}")
        ours = pd.DataFrame(_points_of_run(own, part)).assign(dataset=dataset, published_as=name)
        tables += [ours, *(each.assign(dataset=dataset) for each in _compared(part, ours))]
    return pd.concat(tables, ignore_index=True)[[*CURVE, *_POINT, "place"]]


def curves_of(points: pd.DataFrame) -> Iterator[tuple[dict[str, Any], pd.DataFrame]]:
    """Yield the curves of a table of `beside_published`: what they have in common, and points."""
    for keys, rows in points.fillna({"differs": ""}).groupby(CURVE, sort=False, dropna=False):
        yield dict(zip(CURVE, keys, strict=True)), rows


def _rows_of(source: Source) -> pd.DataFrame:
    rows = source.rows
    rows = rows[~rows["measure"].isin(BD_RATES)].assign(origin=source.title)
    names = {"dataset": "published_as", "measure": "metric", "value": "measured"}
    return rows.rename(columns=names)


# ---- the run


def _prepared(metrics: pd.DataFrame, clouds: pd.DataFrame) -> pd.DataFrame:
    """Return results of a data set with the points of the clouds, and infinite PSNRs if lossless.

    PSNRs with different peaks are left out. ``bpp`` is without attributes if a codec tells it.
    """
    rows = without_mixed_peaks(with_peaks(metrics))
    lossless = lossless_rows(rows)
    psnrs = [name for name in PSNRS[:2] if name in rows]
    rows = rows.assign(**{name: rows[name].mask(lossless, inf) for name in psnrs})
    rows = rows.assign(bpp=rows.get("bpp_geometry", rows["bpp"]).fillna(rows["bpp"]))
    counts = clouds[["dataset", "cloud", "points"]]
    return rows.drop(columns="points", errors="ignore").merge(counts, "left", ["dataset", "cloud"])


def _has(rows: pd.DataFrame, measure: str) -> bool:
    from pointkit.tables import is_number_column

    return measure in rows and is_number_column(rows[measure]) and bool(rows[measure].notna().any())


def _points_of_run(rows: pd.DataFrame, theirs: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield the points of the run's curves, put together as the published clouds are."""
    peak = next(iter(peaks_of_datasets(rows).values()), NOT_STATED)
    is_metric = FRAME in rows and bool(rows[FRAME].eq("metric").any())
    resolution = "metres, as recorded" if is_metric else f"cube [0, {peak}]"
    for cloud in dict.fromkeys(_own_cloud(name, rows) for name in theirs["cloud"]):
        of_cloud = rows if cloud in (MEAN, MEDIAN) else rows[rows["cloud"] == cloud]
        for codec, part in of_cloud.groupby("codec", sort=False):
            for metric in dict.fromkeys(theirs["metric"]):
                curve = {
                    "metric": metric,
                    "origin": HERE,
                    "cloud": cloud,
                    "codec": codec,
                    "codec_version": _texts(part, "codec_version"),
                    "peak": _peak(part, metric, peak),
                    "points": part.drop_duplicates("cloud")["points"].mean(),
                    "frames": float(part["cloud"].nunique()),
                    "resolution": resolution,
                    "machine": _texts(part, _PROCESSORS[metric]) if metric in TIMES else NONE,
                    "differs": "",
                    "place": HERE,
                }
                for rate, bpp, value in _points(part, metric, cloud):
                    yield {**curve, "rate": rate, "bpp": bpp, "measured": value}


def _own_cloud(published: str, rows: pd.DataFrame) -> str:
    """Return what of the run is put beside a published cloud: the same cloud, or an average."""
    return published if published == MEDIAN or published in set(rows["cloud"]) else MEAN


def _points(rows: pd.DataFrame, metric: str, cloud: str) -> Iterator[tuple[str, float, float]]:
    """Yield rate, bits per point and value where every cloud of a codec has a value.

    Rates that are lossless for some clouds only are left out, since they have no mean.
    """
    clouds = rows["cloud"].nunique()
    average = np.median if cloud == MEDIAN else np.mean
    bits = f"bpp_{_ATTRIBUTES[metric]}" if metric in _ATTRIBUTES else "bpp"
    known = rows.reindex(columns=["rate", bits, metric]).dropna()
    for rate, part in known.groupby("rate", sort=False):
        values = part[metric].to_numpy(float)
        if len(values) == clouds and np.isinf(values).all() == np.isinf(values).any():
            value = inf if np.isinf(values).any() else float(average(values))
            yield str(rate), float(average(part[bits])), value


def _peak(rows: pd.DataFrame, metric: str, of_positions: str) -> str:
    """Return the peak of a PSNR as published rows have it: that of luma is 1, its full range."""
    if metric == "reflectance_psnr":
        return _texts(rows, "reflectance_peak")
    others = {"y_psnr": "1", **dict.fromkeys(PSNRS[:2], of_positions)}
    return others.get(metric, NONE)


def _texts(rows: pd.DataFrame, column: str) -> str:
    names: set[str] = set(rows[column].dropna().astype(str)) if column in rows else set()
    return ", ".join(sorted(names)) or NOT_STATED


# ---- differences of conditions


def _compared(theirs: pd.DataFrame, ours: pd.DataFrame) -> Iterator[pd.DataFrame]:
    """Yield the points of each published curve, with its differences from the run."""
    keys = [name for name in CURVE if name in theirs and name != "dataset"]
    for _, part in theirs.groupby(keys, sort=False, dropna=False):
        row = part.iloc[0].to_dict()
        own = ours[ours["metric"] == row["metric"]]
        own = own[own["cloud"] == _partner(row["cloud"], set(own["cloud"]))]
        same = own[own["codec"] == COUNTERPARTS.get(row["codec"])]
        version = " ".join([] if same.empty else same.iloc[0][["codec", "codec_version"]])
        here = own.iloc[0].to_dict() if len(own) else None
        told = ["the run has no such value"] if here is None else _differing(row, here, version)
        yield part.assign(differs="; ".join(told))


def _partner(published: str, own: set[str]) -> str:
    return published if published in own else MEAN


def _differing(row: Mapping[Any, Any], here: Mapping[Any, Any], version: str) -> Iterator[str]:
    if row["cloud"] != here["cloud"]:
        yield _told("cloud", row["cloud"], f"{here['cloud']} of the run's")
    if row["metric"] in PSNRS and not _same_peak(row["peak"], here["peak"]):
        yield _told("peak", row["peak"], here["peak"])
    if not _alike(row["points"], here["points"]):
        yield _told("points", count_text(row["points"]), count_text(here["points"]))
    if row["frames"] != here["frames"]:
        yield _told("frames", count_text(row["frames"]), count_text(here["frames"]))
    if row["resolution"] != here["resolution"]:
        yield _told("coordinates", row["resolution"], here["resolution"])
    if version and row["codec_version"] != version:
        yield _told("version", row["codec_version"], version)
    if row["metric"] in TIMES and not row["machine"] == here["machine"] != NOT_STATED:
        yield _told("machine", row["machine"], here["machine"])


def _told(what: str, there: str, here: str) -> str:
    return f"{what} {there} (here {here})"


def _same_peak(there: str, here: str) -> bool:
    """Return whether two peaks, such as "1023" or "30 m", are known, equal, and of one unit."""
    if NOT_STATED in (there, here):
        return False
    (a, *unit), (b, *own_unit) = there.split(), here.split()
    return unit == own_unit and abs(float(a) - float(b)) <= 1e-3 * float(b)


def _alike(points: float, own: float) -> bool:
    return max(points, own) <= _ALIKE * min(points, own)


def count_text(number: float) -> str:
    """Return a mean number of points or frames as text, or that it is not stated."""
    return NOT_STATED if isnan(number) else f"{number:,.0f}"


# ---- bits at equal quality


def bits_at_equal_quality(points: pd.DataFrame) -> pd.DataFrame:
    """Return the BD-rate of each of the run's codecs against each published curve.

    Parameters
    ----------
    points
        Table of `beside_published`.

    Returns
    -------
    pandas.DataFrame
        A row for each pair: ``dataset``, ``metric``, ``codec`` (of the run), ``origin``, ``cloud``,
        ``anchor`` and ``anchor_version`` (the published codec), ``bd_rate_percent`` (nan if there
        is none), ``bd_rate_status`` (why not) and ``differs``. There is none if the peaks of the
        PSNRs, the clouds or their numbers of points are unknown or differ.
    """
    import pandas as pd

    curves = [(keys, rows) for keys, rows in curves_of(points) if keys["metric"] in PSNRS]
    own = points[points["origin"] == HERE].groupby("dataset")["cloud"].agg(set)
    pairs = [
        _pair(mine, other)
        for mine in curves
        for other in curves
        if mine[0]["origin"] == HERE != other[0]["origin"]
        and all(mine[0][name] == other[0][name] for name in ("dataset", "metric"))
        and mine[0]["cloud"] == _partner(other[0]["cloud"], own[mine[0]["dataset"]])
    ]
    columns = ["dataset", "metric", "codec", "origin", "cloud", "anchor", "anchor_version"]
    more = ["bd_rate_percent", "bd_rate_status", "differs"]
    return pd.DataFrame(pairs, columns=[*columns, *more])


def _pair(
    mine: tuple[dict[str, Any], pd.DataFrame], other: tuple[dict[str, Any], pd.DataFrame]
) -> dict[str, Any]:
    keys, published = mine[0], other[0]
    pair = {name: keys[name] for name in ("dataset", "metric", "codec")}
    pair |= {name: published[name] for name in ("origin", "cloud", "differs")}
    pair |= {"anchor": published["codec"], "anchor_version": published["codec_version"]}
    if status := _incomparable(keys, published):
        return {**pair, "bd_rate_percent": nan, "bd_rate_status": status}
    tested, anchor = (
        rate_distortion_curve(rows["bpp"].to_numpy(float), rows["measured"].to_numpy(float))
        for _, rows in (mine, other)
    )
    delta = bjontegaard_delta(anchor, tested)
    percent = nan if delta.rate_percent is None else delta.rate_percent
    return {**pair, "bd_rate_percent": percent, "bd_rate_status": delta.rate_status}


def _incomparable(mine: Mapping[str, Any], published: Mapping[str, Any]) -> str:
    """Return why two curves have no BD-rate, or an empty text."""
    if not _same_peak(str(published["peak"]), str(mine["peak"])):
        return "another peak"
    if published["cloud"] != mine["cloud"]:
        return "another cloud"
    return "" if _alike(published["points"], mine["points"]) else "other points"


# ---- marks of unequal conditions


def marks_of(points: pd.DataFrame) -> dict[str, str]:
    """Return a mark, such as "[1]", for each text of ``differs`` in a table of `beside_published`.

    Figures and tables show the mark with every curve whose conditions differ from the run's.
    """
    texts = dict.fromkeys(curve["differs"] for curve, _ in curves_of(points) if curve["differs"])
    return {text: f"[{number}]" for number, text in enumerate(texts, 1)}
