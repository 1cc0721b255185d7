from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.figures.style import FigureStyle
    from puckbench.report.comparison import Comparison

_HEADS = ("bits per point", "D1 PSNR, dB", "s, at most")
_DELTA_COLUMNS = (
    *("dataset", "codec", "anchor", "metric", "clouds", "compared"),
    *("bd_rate_percent", "bd_rate_percent_low", "bd_rate_percent_high"),
    *("bd_rate_percent_least", "bd_rate_percent_most"),
    *("bd_quality_db", "bd_quality_db_low", "bd_quality_db_high", "verdict", "scenes"),
    *("no_common_range", "little_overlap", "too_few_points", "lossless", "anchor_lossless"),
)
_OTHER = "*"
"""Mark of times that were not measured in the run, and perhaps on another machine."""


def arguments(parser: argparse.ArgumentParser) -> None:
    from puckbench.report.reference_results import shipped_studies

    add = parser.add_argument
    add("results", type=Path, help="folder of results of a run, or its bundle (.zip)")
    names = ", ".join(shipped_studies())
    text = f"study ({names}), bundle (.zip), or .parquet file of reference results"
    add("--with", dest="study", metavar="STUDY", help=text)
    text = "published numbers (see --as), with their conditions and how these differ"
    add("--published", action="store_true", help=text)
    text = "name of a data set of the run, and of the published one that it is, such as turns=KITTI"
    add("--as", dest="known_as", nargs="+", default=[], metavar="DATASET=NAME", help=text)
    text = "published sources, or your own CSV files of such numbers (default: all sources)"
    add("--sources", nargs="+", default=[], help=text)
    text = "codecs of the run (default: those that STUDY lacks; with --published all)"
    add("--codecs", nargs="+", default=[], help=text)
    add(
        "--metrics",
        nargs="+",
        default=[],
        help="columns of the results (default: those of STUDY, or all)",
    )
    add("--common", action="store_true", help="leave out clouds that STUDY lacks")
    text = "folder of the figure and table (default: RESULTS/comparison; of a bundle: comparison)"
    add("--out", type=Path, help=text)


def run(options: argparse.Namespace) -> dict[str, Any] | str:
    """Compare a run with a study or with published numbers, and return what was found.

    It also writes a figure and tables.

    The answer is text or, with ``--json``, a mapping of values.
    """
    _check_options(options)
    if options.published:
        from puckbench.cli.published import published_answer, published_text

        answer = published_answer(options, *_own_results(options.results))
        return answer if options.json else published_text(answer)
    answer = _compared(options)
    return answer if options.json else text(answer)


def _check_options(options: argparse.Namespace) -> None:
    if (options.study is None) != options.published:
        raise InputError("one of --with STUDY and --published is needed, and only one")
    if options.published and options.common:
        raise InputError("--common is for --with, not for --published")
    for option, values in (("--as", options.known_as), ("--sources", options.sources)):
        if values and not options.published:
            raise InputError(f"{option} is for --published, not for --with")


def _compared(options: argparse.Namespace) -> dict[str, Any]:
    from pointkit.errors import naming
    from pointkit.tables import write_table
    from puckbench.figures.comparison import draw_comparison
    from puckbench.figures.drawing import lay_out, save_figure
    from puckbench.figures.style import FigureStyle
    from puckbench.metrics.peaks import peak_phrase
    from puckbench.report.comparison import compare_with_reference
    from puckbench.report.findings import lossless_text
    from puckbench.report.reference_results import read_reference

    reference = read_reference(options.study)
    metrics, clouds, looks = _own_results(options.results)
    style = FigureStyle.from_config(*reference.about["style"], looks)
    selection = {"codecs": options.codecs, "qualities": options.metrics, "common": options.common}
    with naming(options.results):
        comparison = compare_with_reference(metrics, clouds, reference, **selection)
    qualities = list(dict.fromkeys(comparison.deltas["metric"]))
    folder = options.results if options.results.is_dir() else Path()
    place = (options.out or folder / "comparison") / reference.name
    figures = [place.with_suffix(suffix) for suffix in (".png", ".pdf", ".svg")]
    with style.context():
        tables = (comparison.run_rows, comparison.reference)
        figure = draw_comparison(*tables, qualities, reference.name, style)
        lay_out(figure)
        for path in figures:
            save_figure(figure, path)
    write_table(comparison.deltas, table := place.with_suffix(".csv"))
    return {
        "study": reference.name,
        "codecs": list(dict.fromkeys(comparison.run_rows["codec"])),
        "curves": list(_curves(comparison, style)),
        "processors": {
            "run": _processors(comparison.run_rows),
            "study": _processors(comparison.reference),
        },
        **({"not_timed": reference.not_timed} if reference.not_timed else {}),
        "deltas": [
            _plain(row) for row in comparison.deltas[list(_DELTA_COLUMNS)].to_dict("records")
        ],
        "peak": peak_phrase(comparison.run_rows),
        "lossless": lossless_text(comparison.run_rows, style),
        "left_out": list(comparison.left_out),
        "same_streams": {name: list(counts) for name, counts in comparison.same_streams.items()},
        "files": [str(path) for path in (*figures, table)],
    }


def _own_results(path: Path) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, dict[str, str]]]:
    """Return the tables of results and clouds of a run or bundle, and the style of its codecs."""
    from pointkit.tables import read_table
    from puckbench.core.archives import SUFFIX
    from puckbench.figures.plot_styles import looks_layer, read_looks
    from puckbench.report.reference_results import read_reference
    from puckbench.results.bundles import read_bundle

    if path.suffix.lower() != SUFFIX:
        tables = (path / "tables" / f"{name}.parquet" for name in ("metrics", "clouds"))
        metrics, clouds = map(read_table, tables)
        return metrics, clouds, read_looks(path / "tables")
    own = read_reference(str(path))
    if (of_bundle := own.table("clouds")) is None:
        raise InputError(f"{path}: a bundle without clouds")
    codecs = read_bundle(path).tables.get("codecs", b"").decode()
    return own.metrics, of_bundle, looks_layer(csv.DictReader(io.StringIO(codecs)))


def _processors(rows: pd.DataFrame) -> list[str]:
    """Return the processors on which results were coded, by name; none if they are unknown."""
    names = [name for name in ("cpu", "encode_cpu") if name in rows]
    return sorted({str(cpu) for name in names for cpu in rows[name].dropna()})


def _plain(row: Mapping[Any, Any]) -> dict[str, Any]:
    values = {str(k): v.item() if hasattr(v, "item") else v for k, v in row.items()}
    return {k: None if isinstance(v, float) and isnan(v) else v for k, v in values.items()}


def _curves(comparison: Comparison, style: FigureStyle) -> Iterator[dict[str, Any]]:
    for dataset in style.ordered_datasets(comparison.run_rows["dataset"]):
        for table, is_of_run in ((comparison.run_rows, True), (comparison.reference, False)):
            rows = table[table["dataset"] == dataset]
            for codec in style.ordered_codecs(rows["codec"]):
                yield {
                    "dataset": style.title(dataset),
                    "name": dataset,
                    "codec": codec,
                    "title": style.of_codec(codec).title,
                    "own": is_of_run,
                    **_medians(rows[rows["codec"] == codec]),
                }


def _medians(rows: pd.DataFrame) -> dict[str, Any]:
    from puckbench.metrics.lossless import with_lossless_best, without_lossless
    from puckbench.metrics.peaks import without_mixed_peaks

    columns = [name for name in ("bpp", "d1_psnr", "encode_s", "decode_s") if name in rows]
    counted = with_lossless_best(without_mixed_peaks(rows))
    medians = without_lossless(counted.groupby("rate")[columns].median())
    ranges = {n: [float(medians[n].min()), float(medians[n].max())] for n in columns}
    existing = {n: values for n, values in ranges.items() if not any(map(isnan, values))}
    return {"clouds": int(rows["cloud"].nunique()), **existing}


# ---- for a terminal


def text(answer: Mapping[str, Any]) -> str:
    """Format the answer of this command as text for a terminal.

    The text lists the curves of each data set, and the BD-rates of the run's codecs.
    """
    from puckbench.planning.run_summary import aligned
    from puckbench.report.bd_rate_text import delta_text

    metrics = list(dict.fromkeys(row["metric"] for row in answer["deltas"]))
    deltas = {
        (row["dataset"], row["codec"], row["anchor"], row["metric"]): delta_text(row)
        for row in answer["deltas"]
    }
    lines: list[str] = []
    for name in dict.fromkeys(row["name"] for row in answer["curves"]):
        curves = [row for row in answer["curves"] if row["name"] == name]
        count = curves[0]["clouds"]
        heads = [f"{curves[0]['dataset']}, {count} cloud{'s' if count > 1 else ''}", *_HEADS]
        mine, theirs = ([row for row in curves if row["own"] is own] for own in (True, False))
        rows = [heads, *(_cells(row, row["title"]) for row in mine)]
        rows += [_cells(row, f"{row['title']}, {answer['study']}") for row in theirs]
        lines += [*aligned(rows, left=1), ""]
        for codec in mine:
            pairs = [["bits at equal quality", *map(_short, metrics)]]
            for row in theirs:
                texts = (deltas.get((name, codec["codec"], row["codec"], m), "") for m in metrics)
                pairs.append([f"{codec['title']} against {row['title']}", *texts])
            lines += [*aligned(pairs, left=1 + len(metrics)), ""]
    return "\n".join([*lines, *_closing(answer)])


def _on_times(run: Sequence[str], study: Sequence[str]) -> str:
    here, there = (", ".join(names) or "an unknown processor" for names in (run, study))
    if run == study and run:
        return f"{_OTHER} timed in another run, also on {here}: compare with care."
    return f"{_OTHER} timed on {there}, and the run on {here}: not comparable."


def _short(metric: str) -> str:
    name = metric.removesuffix("_psnr")
    return name.upper() if name in ("d1", "d2") else metric


def _cells(row: Mapping[str, Any], title: str) -> list[str]:
    slowest = sum(row[name][1] for name in ("encode_s", "decode_s") if name in row)
    cells = [_range(row, "bpp", ".3g"), _range(row, "d1_psnr", ".1f")]
    mark = "" if row["own"] else _OTHER
    return [title, *cells, f"{slowest:.2g}{mark}" if slowest else "not timed"]


def _range(row: Mapping[str, Any], name: str, form: str) -> str:
    return " to ".join(f"{value:{form}}" for value in row[name]) if name in row else ""


def _closing(answer: Mapping[str, Any]) -> Iterator[str]:
    yield "A against B: by how much A needs more (+) or fewer (−) bits than B for equal quality;"
    yield "from six scenes on with the 95 % interval and a verdict."
    yield _on_times(**answer["processors"])
    if answer["peak"]:
        yield f"PSNRs D1 and D2: {answer['peak']}."
    if answer["lossless"]:
        yield f"Lossless rates, which have no PSNR and are in no BD-rate: {answer['lossless']}."
    if "not_timed" in answer:
        yield f"{answer['study']} is not timed: {answer['not_timed']}."
    for codec, (same, streams) in answer["same_streams"].items():
        yield f"{codec}: {same} of {streams} streams have the same number of bytes in the study."
    if answer["left_out"]:
        yield f"left out: {', '.join(answer['left_out'])}"
    yield f"files: {', '.join(answer['files'])}"
