"""Numbers of the pages, from the shipped reference results and from what `make measure` measured.

``<!-- shown: NAME -->...<!-- end -->`` in a page holds what the function of that name below
returns, in Markdown. ``python docs/extensions/shipped_numbers.py`` (`make pages`) writes them
again; a test fails if a page is older than the results.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from puckbench.figures.binning import ordered_rates
from puckbench.metrics.statistics import MIN_SCENES, SCENE, Estimate, with_scenes
from puckbench.report.bd_rate_text import delta_text
from puckbench.report.findings import findings, short_title
from puckbench.report.reference_results import ReferenceResults, read_reference
from puckbench.tables.nearest_truth import nearest_truth, truth_bits
from puckbench.tables.noise_bits import noise_bits
from puckbench.tables.perception_bits import bits_needed
from puckbench.tables.perception_losses import perception_losses
from puckbench.tables.rate_deltas import bd_rate, bd_rate_pairs
from puckbench.tables.uses import uses

ROOT = Path(__file__).parents[2]
MARKER = re.compile(r"(<!-- shown: (\w+) -->)(.*?)(<!-- end -->)", re.DOTALL)
SHOWN: dict[str, Callable[[], str]] = {}


def shown(function: Callable[[], str]) -> Callable[[], str]:
    SHOWN[function.__name__] = function
    return function


def pages() -> Iterator[Path]:
    yield ROOT / "README.md"
    yield from sorted((ROOT / "src").glob("*/README.md"))
    yield from sorted((ROOT / "docs").rglob("*.md"))


def renewed(text: str) -> str:
    """Return a page's text with today's numbers."""
    return MARKER.sub(lambda found: f"{found[1]}{SHOWN[found[2]]()}{found[4]}", text)


@cache
def results(study: str) -> ReferenceResults:
    return read_reference(study)


@cache
def table(study: str, name: str) -> pd.DataFrame:
    made = results(study)
    errors, clouds = made.table("scan_errors"), made.table("clouds")
    options = dict(made.bd_rate)
    if name == "nearest_truth":
        return nearest_truth(made.metrics, errors)
    if name == "truth_bits":
        return truth_bits(made.metrics, errors, options["anchor"])
    if name == "noise_bits":
        return noise_bits(made.metrics, clouds)
    if name == "uses":
        return uses(made.metrics, errors, options["margin_percent"])
    return {"bd_rate": bd_rate, "bd_rate_pairs": bd_rate_pairs}[name](made.metrics, **options)


def lines(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, between line breaks."""
    body = [heads, ["---"] * len(heads), *rows]
    return "\n" + "\n".join(f"| {' | '.join(cells)} |" for cells in body) + "\n"


def rows_of(study: str, name: str, **values: str) -> pd.DataFrame:
    rows = table(study, name)
    for column, value in values.items():
        rows = rows[rows[column] == value]
    return rows


def interval(value: float, low: float, high: float, digits: int) -> str:
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def ends(row: Any, column: str, digits: int) -> str:
    return interval(row[column], row[f"{column}_low"], row[f"{column}_high"], digits)


# ---- which codec for what

_DATASETS = {
    "rooms": "rooms, noisy scan",
    "objects": "objects",
    "turns_measured": "turns in rooms",
    "streets_measured": "turns in streets",
    "driving": "ten turns, driving",
}


@shown
def which_codec() -> str:
    """The best codec for each use on the data sets of the evidence."""
    made = results("evidence")
    found = findings(made.metrics, {"uses": table("evidence", "uses")}, made.style)
    titles = {made.style.title(name): words for name, words in _DATASETS.items()}
    columns = {
        "use": "use",
        "clouds": "clouds",
        "codec": "codec",
        "bits per point": "bits",
        "error": "error",
        "largest error": "largest",
        "scenes": "scenes",
        "verdict": "verdict",
    }
    rows = [
        [titles.get(text, text) for text in (getattr(row, name) for name in columns.values())]
        for row in found.uses
        if row.clouds in titles
    ]
    return lines(list(columns), rows)


@shown
def recordings() -> str:
    """Bits of one turn of each recording in the note, and those of the nearest rival."""
    text = (ROOT / "docs" / "notes" / "recordings.md").read_text(encoding="utf-8")
    found = [
        re.search(rf"^\| `{name}` \| (.*) \|$", text, re.MULTILINE) for name in ("puck", "jpegxl")
    ]
    puck, rival = (np.array(row[1].split(" | ")[:-1], float) for row in found if row)
    *most, worst = sorted(rival / puck)
    return (
        f"{len(puck)} recordings, a turn each, without loss: `puck` needs "
        f"{puck.min():.1f} to {puck.max():.1f} bits per return, JPEG XL of the range image "
        f"{min(most):.2f} to {max(most):.2f} times as many (median {np.median(rival / puck):.2f}), "
        f"and {worst:.2f} times in one with dual returns"
    )


# ---- the cost of noise

_NOISE_CODECS = ("puck", "jpegxl", "gpcc_predictive", "gpcc_angular", "gpcc", "draco")
_NOISE_SETS = {"turns": "rooms", "streets": "streets"}
_MODELS = {"none": "none", "measured": "vlp16_measured"}


@shown
def noise_table() -> str:
    rows = []
    for sets, scenes in _NOISE_SETS.items():
        for ending, model in _MODELS.items():
            part = rows_of("evidence", "noise_bits", dataset=f"{sets}_{ending}").set_index("codec")
            bits = [f"{part.loc[codec, 'grid_1_mm']:.2f}" for codec in _NOISE_CODECS]
            rows.append([f"{scenes}, `{model}`", f"{part['noise_bits'].iloc[0]:.2f}", *bits])
    return lines(["turns", "entropy of the noise", *(f"`{c}`" for c in _NOISE_CODECS)], rows)


@shown
def noise_saved() -> str:
    """By how much fewer bits the same rays without noise need, and the added bits, by codec."""
    rows = []
    for codec in _NOISE_CODECS:
        cells = [f"`{codec}`"]
        for sets in _NOISE_SETS:
            part = rows_of("evidence", "noise_bits", dataset=f"{sets}_measured", codec=codec)
            row = part.rename(columns=lambda name: name.replace("_percent", "")).iloc[0]
            cells += [f"{ends(row, 'saved_grid_1_mm', 0)} %", ends(row, "added_grid_1_mm", 1)]
        rows.append(cells)
    heads = ["codec", "rooms: saved", "rooms: added bits", "streets: saved", "streets: added bits"]
    return lines(heads, rows)


def _saved(codec: str, sets: str) -> str:
    row = rows_of("evidence", "noise_bits", dataset=f"{sets}_measured", codec=codec).iloc[0]
    return f"{row['saved_grid_1_mm_percent']:.0f} %"


@shown
def noise_saved_puck() -> str:
    return f"{_saved('puck', 'turns')} in rooms, {_saved('puck', 'streets')} in streets"


@shown
def noise_saved_gpcc() -> str:
    return f"{_saved('gpcc', 'turns')} and {_saved('gpcc', 'streets')}"


@shown
def noise_saved_draco() -> str:
    return f"{_saved('draco', 'turns')} and {_saved('draco', 'streets')}"


@shown
def noise_scenes() -> str:
    counts = [
        rows_of("evidence", "noise_bits", dataset=f"{sets}_measured")["scenes"].max()
        for sets in _NOISE_SETS
    ]
    return f"{counts[0]} rooms and {counts[1]} streets"


# ---- perception


@cache
def _losses_of_tasks() -> pd.DataFrame:
    made = results("perception")
    return perception_losses(made.metrics, clouds=made.table("clouds"))


def _perception_order(column: str) -> list[str]:
    losses, style = _losses_of_tasks(), results("perception").style
    order = style.ordered_codecs if column == "codec" else style.ordered_datasets
    return list(order(losses[column]))


@shown
def perception_bits_table() -> str:
    """Bits per return from which on each task is not worse, with the rate, by codec."""
    losses, style = _losses_of_tasks(), results("perception").style
    codecs = _perception_order("codec")
    bits, rows = bits_needed(losses), []
    lowest = losses.groupby(["dataset", "codec"])["bits"].min()
    for task in dict.fromkeys(bits["task"]):
        for dataset in _perception_order("dataset"):
            part = bits[(bits["task"] == task) & (bits["dataset"] == dataset)].set_index("codec")
            if part.empty:
                continue
            first = part.iloc[0]
            head = f"{first['task_title']}; {style.title(dataset)} ({first['scenes']})"
            cells = [_bits_cell(part.loc[codec], lowest[dataset, codec]) for codec in codecs]
            rows.append([head, f"{first['undecoded']:.1f}", *cells])
    return lines(["task; scans (scenes)", "undecoded, %", *(f"`{name}`" for name in codecs)], rows)


def _bits_in_streets(task: str) -> str:
    bits = bits_needed(_losses_of_tasks())
    of_streets = bits[(bits["task"] == task) & (bits["dataset"] != "rooms")]
    puck, gpcc = (
        ", ".join(
            "none" if np.isnan(value) else f"{value:.2f}"
            for value in of_streets[of_streets["codec"] == codec]["bits"]
        )
        for codec in ("puck", "gpcc")
    )
    return f"{puck} bits of `puck` and {gpcc} of `gpcc`"


@shown
def perception_bits_of_ground() -> str:
    """Bits per return with which Patchwork++ agrees with its answer on undecoded streets."""
    return _bits_in_streets("ground_agreement")


@shown
def perception_bits_of_network() -> str:
    """Bits per return that were shown to suffice for our network in streets."""
    return _bits_in_streets("segmentation")


def _bits_cell(row: Any, lowest: float) -> str:
    if pd.isna(row["bits"]):
        return f"none up to {row['most_bits']:.2f}"
    return f"{'≤ ' if row['bits'] <= lowest else ''}{row['bits']:.2f} ({row['rate']})"


@cache
def _scans_of_perception() -> pd.DataFrame:
    return with_scenes(results("perception").metrics)


def _of_scenes(dataset: str, rate: str, codec: str) -> pd.DataFrame:
    """Return the mean results of each scene, a row for each, by one codec at one rate."""
    made = _scans_of_perception()
    named = (made["dataset"] == dataset) & (made["rate"] == rate) & (made["codec"] == codec)
    return made[named].groupby(SCENE).mean(numeric_only=True)


@shown
def perception_losses_table() -> str:
    """Losses of mean IoU by our network for steps of `puck`, `gpcc` and `draco`.

    The last columns are the losses by the decoded points alone.
    """
    style, rows = results("perception").style, []
    for dataset in _perception_order("dataset"):
        for rate in ("500mm", "200mm", "100mm"):
            asked, alone = [], []
            for codec in ("puck", "gpcc", "draco"):
                part = _of_scenes(dataset, rate, codec)
                undecoded, coded, decoded = (
                    part[f"segmentation_{way}miou_percent"]
                    for way in ("undecoded_", "", "decoded_")
                )
                bits = part["bpp"].mean()
                asked.append(f"{bits:.2f} bits: {_estimate(undecoded - coded)}")
                alone.append(_estimate(undecoded - decoded))
            rows.append([f"{style.title(dataset)}, {rate}", *asked, *alone[1:]])
    heads = ["scans, step", "`puck`", "`gpcc`", "`draco`"]
    return lines([*heads, "`gpcc`, decoded alone", "`draco`, decoded alone"], rows)


@shown
def perception_pairs_table() -> str:
    """Losses of mean IoU by `gpcc` minus those by `puck` at equal steps, and bits of both.

    Differences that are not zero by Holm's correction for all comparisons are bold.
    """
    style = results("perception").style
    names, rows, differences = ("gpcc", "gpcc_angular", "puck"), [], []
    for dataset in _perception_order("dataset"):
        for rate in ("500mm", "200mm", "100mm", "50mm", "20mm"):
            scenes = {codec: _of_scenes(dataset, rate, codec) for codec in names}
            bits = (f"{scenes[codec]['bpp'].mean():.2f}" for codec in names)
            rows.append([f"{style.title(dataset)}, {rate}", *bits])
            puck, gpcc = (scenes[name]["segmentation_miou_percent"] for name in ("puck", "gpcc"))
            differences.append(puck - gpcc)
    shown_different = _different_by_holm(differences)
    for row, difference, is_shown in zip(rows, differences, shown_different, strict=True):
        row.append(f"**{_estimate(difference)}**" if is_shown else _estimate(difference))
    heads = [f"`{codec}`, bits" for codec in names]
    return lines(["scans, step", *heads, "`gpcc` loses more by, points"], rows)


def _different_by_holm(samples: list[pd.Series[float]]) -> list[bool]:
    """Return whose mean is not 0 at 5 % in all, by Student's t with the correction of Holm."""
    p = np.array([stats.ttest_1samp(sample, 0).pvalue for sample in samples])
    order = np.argsort(p)
    adjusted = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    found = np.empty(len(p), np.bool_)
    found[order] = adjusted <= 0.05
    return [bool(each) for each in found]


def _estimate(values: pd.Series[float]) -> str:
    estimate = Estimate.of(values)
    return interval(estimate.mean, estimate.low, estimate.high, 1)


# ---- primitives

_TRUTH = ("accuracy, plane", "completeness, plane", "D2", "D1", "99 %", "largest")


@shown
def primitives_truth() -> str:
    """Distances to the true surface of every rate of `primitives`, in percent of the scan's."""
    part = rows_of("evidence", "nearest_truth", dataset="rooms", codec="primitives")
    rates = list(dict.fromkeys(part["rate"]))
    rows = []
    for rate in rates:
        by_distance = part[part["rate"] == rate].set_index("distance")
        shares = [ends(by_distance.loc[name], "percent_of_scan", 0) for name in _TRUTH]
        rows.append([rate, f"{by_distance['bpp'].iloc[0]:.3g}", *shares])
    scan = part[part["rate"] == rates[0]].set_index("distance")["scan_mm"]
    rows.append(["scan", "", *(f"{scan[name]:.1f} mm" for name in _TRUTH)])
    return lines(["rate", "bits", *_TRUTH], rows)


@shown
def primitives_nearest() -> str:
    part = rows_of("evidence", "nearest_truth", dataset="rooms", codec="primitives", distance="D2")
    row = part.sort_values("percent_of_scan").iloc[0]
    return (
        f"{ends(row, 'percent_of_scan', 0)} % of the scan's at {row['rate']}, {row['bpp']:.2g} bits"
    )


@shown
def rivals_truth() -> str:
    """The nearest rate of other codecs (one rate for all rooms), in percent of the scan's."""
    rows = []
    for codec in ("gpcc_denoised", "gpcc", "draco", "pcgcv2_plus_rooms"):
        part = rows_of("evidence", "nearest_truth", dataset="rooms", codec=codec)
        best = part[part["distance"] == "D2"].sort_values("percent_of_scan")["rate"].iloc[0]
        by_distance = part[part["rate"] == best].set_index("distance")
        shares = [ends(by_distance.loc[name], "percent_of_scan", 0) for name in _TRUTH]
        rows.append([f"`{codec}` {best}", f"{by_distance['bpp'].iloc[0]:.3g}", *shares])
    return lines(["codec and rate", "bits", *_TRUTH], rows)


@shown
def primitives_bits() -> str:
    """How many times the bits of `primitives` G-PCC needs at each of its rates."""
    cells: dict[str, list[str]] = {}
    names = ("accuracy, plane", "completeness, plane", "D2", "D1")
    for name in names:
        part = rows_of("evidence", "truth_bits", dataset="rooms", codec="primitives", distance=name)
        for _, row in part.iterrows():
            text = "none gets as near"
            if row["scenes"]:
                text = f"{row['bits_ratio']:.1f}"
                if row["scenes"] >= MIN_SCENES:
                    text = ends(row, "bits_ratio", 1)
                if row["scenes"] < row["of"]:
                    text += f", {row['scenes']} of {row['of']} rooms"
            head = f"{row['rate']}, {row['anchor_bpp']:.2g} bits"
            cells.setdefault(head, []).append(text)
    return lines(["G-PCC's rate", *names], [[head, *texts] for head, texts in cells.items()])


# ---- puck


@shown
def jpegxl_more() -> str:
    """How many more bits JPEG XL needs than `puck` for lossless turns."""
    texts = []
    for dataset, words in (("turns_measured", "rooms"), ("streets_measured", "streets")):
        row = rows_of("evidence", "uses", dataset=dataset, use="archive", codec="jpegxl").iloc[0]
        more = (100 * (row[name] - 1) for name in ("ratio", "ratio_low", "ratio_high"))
        texts.append(f"{interval(*more, 1)} % in {words}")
    return ", ".join(texts)


@shown
def smoothed_truth() -> str:
    """Distances of `puck_smoothed` at the rate that is nearest in D2 (one for all scenes)."""
    rows = []
    for dataset, words in (("turns_measured", "rooms"), ("streets_measured", "streets")):
        part = rows_of("evidence", "nearest_truth", dataset=dataset, codec="puck_smoothed")
        best = part[part["distance"] == "D2"].sort_values("percent_of_scan")["rate"].iloc[0]
        by_distance = part[part["rate"] == best].set_index("distance")
        shares = [f"{ends(by_distance.loc[name], 'percent_of_scan', 0)} %" for name in _TRUTH]
        count = by_distance["scenes"].iloc[0]
        rows.append([f"{words} ({count}), {best}", f"{by_distance['bpp'].iloc[0]:.3g}", *shares])
    return lines(["turns, rate", "bits", *_TRUTH], rows)


def _at_steps(dataset: str, codec: str, rate: str) -> pd.Series[float]:
    metrics = with_scenes(results("evidence").metrics)
    rows = metrics[
        (metrics["dataset"] == dataset) & (metrics["codec"] == codec) & (metrics["rate"] == rate)
    ]
    return rows.groupby(SCENE)["bpp"].mean()


def ratio_text(tested: pd.Series[float], base: pd.Series[float], digits: int = 2) -> str:
    """Return the ratio of bits over scenes, with its interval from six scenes on."""
    both = pd.concat([tested, base], axis=1, keys=["tested", "base"]).dropna()
    ratio = Estimate.of_ratios(both["tested"] / both["base"])
    if ratio.scenes < MIN_SCENES:
        return f"{ratio.mean:.{digits}f} ({ratio.scenes} scenes)"
    return interval(ratio.mean, ratio.low, ratio.high, digits)


@shown
def steps_table() -> str:
    """Bits of `puck` and of G-PCC's modes at equal steps, on single turns and on ten turns."""
    rows = []
    for step in ("20mm", "10mm", "2mm"):
        for dataset in ("turns_measured", "streets_measured", "driving"):
            base = _at_steps(dataset, "puck", step)
            cells = [f"{_DATASETS[dataset]}, {step}", f"{base.mean():.2f}"]
            names = ("puck_key_turns", "gpcc_predictive", "gpcc_angular", "gpcc")
            for codec in names:
                bits = _at_steps(dataset, codec, step)
                cells.append(ratio_text(bits, base) if len(bits) else "")
            rows.append(cells)
    heads = ["turns, step", "`puck`, bits per return", "`puck_key_turns`", "`gpcc_predictive`"]
    return lines([*heads, "`gpcc_angular`", "`gpcc`"], rows)


# ---- learned codecs


def _net_rows() -> Iterator[list[str]]:
    metrics = with_scenes(results("evidence").metrics)
    for dataset in ("rooms", "objects", "turns_measured", "streets_measured"):
        part = metrics[metrics["dataset"] == dataset]
        pair = part[part["codec"].isin(["gpcc", "sparse_octree_net"])]
        merged = pair[pair["codec"] == "sparse_octree_net"].merge(
            pair[pair["codec"] == "gpcc"], on=["cloud", "points_out"], suffixes=("", "_gpcc")
        )
        same = merged[np.isclose(merged["d1_mse"], merged["d1_mse_gpcc"], rtol=1e-3)]
        for rate, rows in same.groupby("rate_gpcc", sort=False):
            ratio = Estimate.of_ratios(rows["bpp"] / rows["bpp_gpcc"])
            if ratio.scenes >= MIN_SCENES:
                text = interval(
                    *(100 * (value - 1) for value in (ratio.mean, ratio.low, ratio.high)), 1
                )
                yield [_DATASETS[dataset], str(rate), f"{text} %", str(ratio.scenes)]


@shown
def net_bits() -> str:
    """Bits of the sparse octree net relative to G-PCC's for the same decoded points."""
    return lines(["clouds", "G-PCC's rate", "change of the bits", "scenes"], list(_net_rows()))


_D1_D2 = ("d1_psnr", "d2_psnr")


def _delta(codec: str, dataset: str, metric: str, study: str = "evidence") -> str:
    return _text_of(rows_of(study, "bd_rate", codec=codec, dataset=dataset, metric=metric))


def _text_of(deltas: pd.DataFrame) -> str:
    return delta_text(deltas.iloc[0].to_dict() if len(deltas) else None)


def deltas(codec: str, datasets: Sequence[str]) -> str:
    rows = [
        [_DATASETS[name], *(_delta(codec, name, metric) for metric in _D1_D2)] for name in datasets
    ]
    return lines(["clouds", "BD-rate, D1", "BD-rate, D2"], rows)


@shown
def pcgcv1_deltas() -> str:
    return deltas("pcgcv1_plus", ["objects"])


@shown
def pcgcv2_deltas() -> str:
    return deltas("pcgcv2_plus", ["objects"])


@shown
def pcgcv2_rooms_deltas() -> str:
    return deltas("pcgcv2_plus_rooms", ["rooms"])


@shown
def primitives_deltas() -> str:
    return deltas("primitives", ["rooms", "objects"])


@shown
def primitives_pairs() -> str:
    """BD-rates of `primitives` against the codecs that also smooth or were made for its clouds."""
    rivals = {
        "rooms": ("gpcc", "gpcc_denoised", "pcgcv2_plus_rooms"),
        "objects": ("gpcc", "pcgcv2_plus", "pcgcv1_plus"),
    }
    rows = []
    for dataset, names in rivals.items():
        for anchor in names:
            pair = {"codec": "primitives", "dataset": dataset, "anchor": anchor}
            cells = [_DATASETS[dataset], f"`{anchor}`"]
            pairs = (
                rows_of("evidence", "bd_rate_pairs", metric=metric, **pair) for metric in _D1_D2
            )
            rows.append([*cells, *map(_text_of, pairs)])
    return lines(["clouds", "against", "BD-rate, D1", "BD-rate, D2"], rows)


@shown
def sensor_modes() -> str:
    """BD-rates of G-PCC's modes for sensors against its octree."""
    rows = [
        [_DATASETS[name], f"`{codec}`", *(_delta(codec, name, metric) for metric in _D1_D2)]
        for name in ("turns_measured", "streets_measured", "driving")
        for codec in ("gpcc_angular", "gpcc_predictive")
    ]
    return lines(["clouds", "mode", "BD-rate, D1", "BD-rate, D2"], rows)


@shown
def draco_deltas() -> str:
    return deltas("draco", ["rooms", "objects", "turns_measured", "streets_measured"])


def _growth(codec: str) -> tuple[int, list[str], list[float]]:
    """Return the number of clouds of the default run, the rates at which bits or D1 do not grow,
    and the ratios of the bits of successive rates.
    """
    metrics = results("default").metrics
    clouds = list(metrics[metrics["codec"] == codec].groupby(["dataset", "cloud"], sort=False))
    worse, ratios = [], []
    for (dataset, cloud), rows in clouds:
        curve = rows.set_index("rate").loc[ordered_rates(set(rows["rate"]))]
        ratios += list((curve["bpp"] / curve["bpp"].shift()).dropna())
        falls = (curve["bpp"].diff() <= 0) | (curve["d1_psnr"].diff() <= 0)
        worse += [f"{dataset}/{cloud} {rate}" for rate in curve.index[falls]]
    return len(clouds), worse, ratios


def growth_text(codec: str) -> str:
    clouds, worse, ratios = _growth(codec)
    exceptions = f", except at {', '.join(worse)}" if worse else ""
    return (
        f"On the {clouds} clouds of the default run bits and D1 grow from each rate to the next"
        f"{exceptions}; bits grow {min(ratios):.2f} to {max(ratios):.2f} times"
    )


@shown
def pcgcv1_growth() -> str:
    return growth_text("pcgcv1_plus")


@shown
def pcgcv2_growth() -> str:
    return growth_text("pcgcv2_plus")


@shown
def learned_deltas() -> str:
    texts = [
        f"`{codec}` {_delta(codec, 'objects', metric)} ({short_title(metric)})"
        for codec in ("pcgcv2_plus", "pcgcv1_plus")
        for metric in _D1_D2
    ]
    return "; ".join(texts)


@shown
def arena_bits() -> str:
    """Bits of `gpcc_arena` relative to those of `gpcc` at equal scales, in the default run."""
    metrics = results("default").metrics
    scales = {"r1": "s0.125", "r4": "s0.5", "r8": "s1"}
    arena = metrics[(metrics["codec"] == "gpcc_arena") & metrics["rate"].isin(scales)]
    arena = arena.assign(same=arena["rate"].map(scales))
    both = arena.merge(
        metrics[metrics["codec"] == "gpcc"],
        left_on=["dataset", "cloud", "same"],
        right_on=["dataset", "cloud", "rate"],
    )
    change = 100 * (both["bpp_x"] / both["bpp_y"] - 1)
    return f"{change.min():.0f} to {change.max():.0f} %"


# ---- performance, from the file that `make measure` writes

PERFORMANCE = ROOT / "docs" / "notes" / "performance.json"


@cache
def measured() -> dict[str, dict[str, Any]]:
    """Return the subjects of the last measurements, by name."""
    subjects: dict[str, dict[str, Any]] = json.loads(PERFORMANCE.read_text(encoding="utf-8"))
    return subjects


def measured_rows(subject: str, *parts: str, unit: str = "") -> list[dict[str, Any]]:
    """Return the rows that contain all parts; raise LookupError if there are none."""
    rows = [
        row
        for row in measured().get(subject, {"rows": []})["rows"]
        if all(part in row["what"] for part in parts) and row["unit"] == (unit or row["unit"])
    ]
    if not rows:
        raise LookupError(f"{PERFORMANCE}: no row of {subject} has {parts} {unit}")
    return rows


def figure(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 or value == int(value) else f"{value:.3g}"


def spread(values: Sequence[float]) -> str:
    """Return the least and the greatest value, as text; of equal texts one."""
    return " to ".join(dict.fromkeys(map(figure, (min(values), max(values)))))


def _aim(row: dict[str, Any]) -> str:
    if "is_met" not in row:
        return ""
    sign, aim = ("≤", row["at_most"]) if "at_most" in row else ("≥", row["at_least"])
    return f"{sign} {figure(aim)}: {'met' if row['is_met'] else '**missed**'}"


def _conclusion(rows: Sequence[dict[str, Any]]) -> str:
    """Return the ratios to each rival and the aims of a subject, as sentences."""
    ratios: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        if "ratio" in row:
            ratios.setdefault((row["unit"], row["rival"]), []).append(row["ratio"])
    texts = [
        f"Ratio to {rival} in {unit}: {spread(values)}, median {figure(float(np.median(values)))}."
        for (unit, rival), values in ratios.items()
    ]
    if aims := [row for row in rows if "is_met" in row]:
        missed = [f"{row['what']} ({row['unit']})" for row in aims if not row["is_met"]]
        text = f"Aims met: {len(aims) - len(missed)} of {len(aims)}"
        texts.append(f"{text}; missed: {'; '.join(missed)}." if missed else f"{text}.")
    return " ".join(texts)


@shown
def performance_conclusion() -> str:
    """How many aims each subject meets."""
    texts, counts = [], np.zeros(2, int)
    for subject in measured().values():
        aims = [row["is_met"] for row in subject["rows"] if "is_met" in row]
        if aims:
            texts.append(f"{subject['title']} {sum(aims)} of {len(aims)}")
            counts += sum(aims), len(aims)
    return f"{counts[0]} of {counts[1]} aims are met ({'; '.join(texts)})"


@shown
def performance_tables() -> str:
    """A section for each subject: where and when it was measured, its conclusion, its rows."""
    texts = []
    for name, subject in measured().items():
        place = f"{subject['processor']}, {subject['cores']} cores"
        when = f"{subject['date']}, commit `{subject['commit']}`, {subject['minutes']:g} min"
        rows = [
            [
                row["what"],
                f"{figure(row['value'])} {row['unit']}",
                f"{row['rival']}: {figure(row['rival_value'])}" if "rival" in row else "",
                f"{row['ratio']:.3g}" if "ratio" in row else "",
                _aim(row),
                str(row["repeats"]),
            ]
            for row in subject["rows"]
        ]
        table = lines(["what", "value", "rival", "ratio", "aim", "runs"], rows)
        head = f"## {subject['title']}\n\n`make measure SUBJECTS={name}`: {place}, {when}."
        texts.append(f"{head} {_conclusion(subject['rows'])}".rstrip() + f"\n{table}")
    return "\n" + "\n".join(texts)


@shown
def run_time() -> str:
    row = measured_rows("run", "to the end")[0]
    return f"{row['value'] / 60:.0f} minutes"


@shown
def puck_speed() -> str:
    """Lossless turns of a VLP-16 by effort, encoding and decoding."""
    texts = []
    for effort in ("fast", "normal", "thorough"):
        rows = measured_rows("puck", f"VLP-16, {effort}: ", unit="x real time")
        texts.append(f"{spread([row['value'] for row in rows])} times real time with `{effort}`")
    return ", ".join(texts)


@shown
def scan_times() -> str:
    """Ratios to the bare ray cast in processor time, by error model."""
    ratios = [row["ratio"] for row in measured_rows("scans", "scan of", unit="processor s")]
    return f"{spread(ratios)} times the processor time of a bare ray cast"


@shown
def gpcc_times() -> str:
    """Ratios to TMC13's processor time, over all modes."""
    encode, decode = (
        spread([row["ratio"] for row in measured_rows("gpcc", f": {action}", unit="processor s")])
        for action in ("encode", "decode")
    )
    return f"encoding takes {encode} times TMC13's processor time, decoding {decode}"


def codec_times(codec: str) -> str:
    encode, decode, memory = (
        measured_rows("codecs", f" {codec} ", what)[0] for what in ("encode", "decode", "memory")
    )
    cloud, points = encode["what"].split(", ")[:2]
    return (
        f"{points} of the cloud `{cloud}` take {figure(encode['value'])} s to encode and "
        f"{figure(decode['value'])} s to decode, with {figure(memory['value'])} MiB"
    )


@shown
def pcgcv2_times() -> str:
    return codec_times("pcgcv2_plus")


@shown
def primitives_times() -> str:
    return codec_times("primitives")


@shown
def sparse_octree_net_times() -> str:
    return codec_times("sparse_octree_net")


if __name__ == "__main__":
    for path in pages():
        text = path.read_text(encoding="utf-8")
        if (new := renewed(text)) != text:
            path.write_text(new, encoding="utf-8")
            sys.stdout.write(f"{path.relative_to(ROOT)}\n")
