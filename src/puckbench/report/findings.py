"""The findings of a run: which codec to use for what, and the BD-rates of all codecs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING, Any

from puckbench.figures.binning import ordered_rates
from puckbench.figures.style import FigureStyle
from puckbench.metrics.lossless import lossless_rows
from puckbench.metrics.statistics import (
    BETTER,
    MIN_SCENES,
    NO_VERDICT,
    NOT_WORSE,
    UNDECIDED,
    WITHIN,
)
from puckbench.report.bd_rate_text import delta_note, delta_text, delta_value
from puckbench.report.plot_data import codec_payload
from puckbench.results.columns import column_named
from puckbench.tables.cells import interval_text
from puckbench.tables.uses import FEWEST, NEAREST, USES

if TYPE_CHECKING:
    import pandas as pd

_DASH = "\N{EN DASH}"
_NEAR = (UNDECIDED, NOT_WORSE, NO_VERDICT)
"""Verdicts with which a codec is named beside the best one."""
_NAMED = 3
"""Largest number of codecs that the verdict on a use names besides the best one."""


@dataclass(frozen=True)
class UseRow:
    """A row of the page's first table: the best codec for a use on a data set, as text.

    Parameters
    ----------
    use, clouds, codec
        What the codec is used for, title of the data set, and title of the codec.
    bits, error, largest
        Bits per point, the error that the use limits, and the largest error, with units.
    seconds
        Time to encode and decode a million points.
    scenes
        Number of scenes in which the codec is suitable for the use.
    verdict
        What the confidence intervals say of the codec and its rivals.
    is_decided
        Whether the verdict names the codec as the winner.
    """

    use: str
    clouds: str
    codec: str
    bits: str
    error: str
    largest: str
    seconds: str
    scenes: str
    verdict: str
    is_decided: bool


@dataclass(frozen=True)
class Cell:
    """Cell of a table of BD-rates: a value as text, and a note that qualifies it."""

    text: str = _DASH
    note: str = ""


@dataclass(frozen=True)
class DatasetFindings:
    """BD-rates of all codecs on one data set, for a table of the page.

    Parameters
    ----------
    title
        Title of the data set.
    clouds
        Number of clouds.
    statements
        Result of the direct comparisons of all pairs of codecs, as a sentence, by heading.
    columns
        Cells of a column by name of the codec, by heading of the column.
    codecs
        Name, title and style of each codec.
    """

    title: str
    clouds: int
    statements: Mapping[str, str]
    columns: Mapping[str, Mapping[str, Cell]]
    codecs: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class Findings:
    """What the page says first about a run.

    Parameters
    ----------
    uses
        The best codecs for several uses.
    datasets
        BD-rates on each data set.
    anchor
        Title of the codec to which BD-rates are relative, or empty.
    lossless
        The lossless rates of the codecs, as text.
    """

    uses: tuple[UseRow, ...]
    datasets: tuple[DatasetFindings, ...]
    anchor: str = ""
    lossless: str = ""


def findings(
    metrics: pd.DataFrame | None, tables: Mapping[str, pd.DataFrame], style: FigureStyle
) -> Findings:
    """Return the findings of a run, from its tables.

    Parameters
    ----------
    metrics
        Results of the run; None if only drives were coded. Then only the table ``odometry_bits``
        counts.
    tables
        Tables of the run by name, of which ``uses``, ``bd_rate``, ``bd_rate_pairs`` and
        ``odometry_bits`` are used if they exist.
    style
        Style of the figures, for titles and the order of codecs.
    """
    drives = tuple(_drive_rows(tables["odometry_bits"], style)) if "odometry_bits" in tables else ()
    if metrics is None:
        return Findings(drives, ())
    deltas, pairs = tables.get("bd_rate"), tables.get("bd_rate_pairs")
    datasets = style.ordered_datasets(metrics["dataset"])
    anchor = "" if deltas is None else style.of_codec(deltas["anchor"].iloc[0]).title
    of_datasets = []
    if deltas is not None and pairs is not None:
        of_datasets = [_of_dataset(name, metrics, deltas, pairs, style) for name in datasets]
    rows = tuple(_use_rows(tables["uses"], datasets, style)) if "uses" in tables else ()
    return Findings((*rows, *drives), tuple(of_datasets), anchor, lossless_text(metrics, style))


def lossless_text(metrics: pd.DataFrame, style: FigureStyle) -> str:
    """Return the lossless rates of each codec, such as "G-PCC 1mm (3 clouds)", or an empty text."""
    rows = metrics[lossless_rows(metrics)]
    texts = []
    for codec in style.ordered_codecs(rows["codec"]):
        codec_rows = rows[rows["codec"] == codec]
        clouds = len(codec_rows[["dataset", "cloud"]].drop_duplicates())
        rates = ", ".join(ordered_rates(set(codec_rows["rate"])))
        cloud_count = "1 cloud" if clouds == 1 else f"{clouds} clouds"
        texts.append(f"{style.of_codec(codec).title} {rates} ({cloud_count})")
    return "; ".join(texts)


# ---- which codec for what


def _use_rows(table: pd.DataFrame, datasets: list[str], style: FigureStyle) -> Iterator[UseRow]:
    for use in USES:
        for dataset in datasets:
            rows = table[(table["use"] == use) & (table["dataset"] == dataset)]
            if len(rows):
                yield _use_row(
                    rows.to_dict("records"), USES[use].words, style.title(dataset), style
                )


def _use_row(rows: list[dict[Any, Any]], use: str, clouds: str, style: FigureStyle) -> UseRow:
    best = rows[0]
    return UseRow(
        use=use,
        clouds=clouds,
        codec=style.of_codec(best["codec"]).title,
        bits=f"{best['bpp']:.3g}",
        error=_length_text(best["error_mm"]),
        largest=_length_text(best["largest_mm"]),
        seconds="not timed" if isnan(best["seconds"]) else f"{best['seconds']:.2g} s",
        scenes=str(best["scenes"]),
        verdict=_verdict_text(rows, style),
        is_decided=best["verdict"] in (FEWEST, NEAREST),
    )


def _drive_rows(table: pd.DataFrame, style: FigureStyle) -> Iterator[UseRow]:
    for (dataset, odometry), part in table.groupby(["dataset", "odometry"], sort=False):
        best = part.sort_values("bits", na_position="last").to_dict("records")[0]
        unit, verdict = best["unit"], str(best["verdict"])
        enough = verdict in (NOT_WORSE, WITHIN)
        if verdict == NOT_WORSE:
            added = interval_text(best["difference"], best["low"], best["high"])
            verdict = f"coding adds {added} {unit} to {best['undecoded']:.2g} {unit}"
        yield UseRow(
            use=f"odometry ({odometry}): coding adds less than {best['margin']:.2g} {unit}",
            clouds=style.title(str(dataset)),
            codec=style.of_codec(best["codec"]).title if enough else _DASH,
            bits=f"{best['bits']:.3g}" if enough else _DASH,
            error=f"{best['value']:.2g}\N{NO-BREAK SPACE}{unit}" if enough else _DASH,
            largest=_DASH,
            seconds=_DASH,
            scenes=str(best["trajectories"]),
            verdict=verdict,
            is_decided=False,
        )


def _length_text(value: float) -> str:
    return _DASH if isnan(value) else f"{value:.3g}\N{NO-BREAK SPACE}mm"


def _verdict_text(rows: list[dict[Any, Any]], style: FigureStyle) -> str:
    best, *others = rows
    if isnan(best["ratio"]):
        return "no codec in every scene"
    if not others:
        return "the only one"
    partly = [style.of_codec(row["codec"]).title for row in others if isnan(row["ratio"])]
    also = f"; in some scenes alone {', '.join(partly[:_NAMED])}" if partly else ""
    others = [row for row in others if not isnan(row["ratio"])]
    if not others:
        return f"the only one in every scene{also}"
    if best["verdict"] in (FEWEST, NEAREST):
        rival = style.of_codec(others[0]["codec"]).title
        ratio, low, high = (others[0][name] for name in ("ratio", "ratio_low", "ratio_high"))
        what = "error" if best["verdict"] == NEAREST else "bits"
        times = f"{interval_text(ratio, low, high)} times the {what}"
        return f"{best['verdict']}; {rival} has {times}{also}"
    near = [row["codec"] for row in others if row["verdict"] in _NEAR][:_NAMED]
    titles = ", ".join(style.of_codec(codec).title for codec in near)
    return f"{best['verdict']}{f'; then {titles}' if titles else ''}{also}"


# ---- BD-rates


def _of_dataset(
    name: str, metrics: pd.DataFrame, deltas: pd.DataFrame, pairs: pd.DataFrame, style: FigureStyle
) -> DatasetFindings:
    rows = metrics[metrics["dataset"] == name]
    codecs = style.ordered_codecs(rows["codec"])
    anchor, of_set = deltas["anchor"].iloc[0], deltas[deltas["dataset"] == name]
    statements, columns, clouds = {}, {}, rows["cloud"].nunique()
    for metric in dict.fromkeys(of_set["metric"]):
        by_codec = of_set[of_set["metric"] == metric].set_index("codec").to_dict("index")
        heading = f"BD-rate, {short_title(metric)}"
        columns[heading] = {
            codec: Cell("0 %", "reference") if codec == anchor else _bd_rate(by_codec.get(codec))
            for codec in codecs
        }
        of_metric = pairs[(pairs["dataset"] == name) & (pairs["metric"] == metric)]
        statements[heading] = ranking_text(of_metric, codecs, clouds, style)
    described = tuple(codec_payload(codec, style) for codec in codecs)
    return DatasetFindings(style.title(name), clouds, statements, columns, described)


def short_title(metric: str) -> str:
    """Return a metric's name for headings, such as "D1" for ``d1_psnr``."""
    bare = metric.removesuffix("_psnr")
    return bare.upper() if bare in ("d1", "d2") else column_named(metric).words


def _bd_rate(row: Mapping[Any, Any] | None) -> Cell:
    return Cell(delta_value(row) or _DASH, delta_note(row))


def ranking_text(
    pairs: pd.DataFrame, codecs: Sequence[str], clouds: int, style: FigureStyle
) -> str:
    """Return a sentence that says which codec needs the fewest bits on a data set.

    One codec is named if it is better than every other codec on all clouds. Otherwise, the codecs
    are named than which no other codec is better.

    Parameters
    ----------
    pairs
        Rows of the table ``bd_rate_pairs`` for the data set and one metric.
    codecs
        Names of all codecs of the data set.
    clouds
        Number of clouds of the data set.
    style
        Style of the figures, for titles of codecs.
    """
    rows = pairs.to_dict("records")
    if max((row["scenes"] for row in rows), default=0) < MIN_SCENES:
        return f"no verdict: fewer than {MIN_SCENES} scenes with comparable curves"
    for codec in codecs:
        against = [row for row in rows if row["codec"] == codec]
        if len(against) == len(codecs) - 1 and all(
            row["verdict"] == BETTER and row["compared"] == clouds for row in against
        ):
            closest = max(against, key=lambda row: float(row["bd_rate_percent"]))
            title, rival = (style.of_codec(name).title for name in (codec, closest["anchor"]))
            return f"{title} needs the fewest bits; next {rival}: {delta_text(closest)}"
    beaten = {row["anchor"] for row in rows if row["verdict"] == BETTER}
    unbeaten = [style.of_codec(codec).title for codec in codecs if codec not in beaten]
    count = len(codecs) * (len(codecs) - 1) // 2
    apart = count - sum(row["compared"] == clouds for row in rows) // 2
    unknown = f"; {apart} of {count} pairs not comparable on all clouds" if apart else ""
    named = ", ".join(unbeaten) or "none"
    return f"no codec is better than every other; not beaten: {named}{unknown}"
