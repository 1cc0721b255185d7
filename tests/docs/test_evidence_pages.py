"""The numbers of the pages are those of the shipped reference results."""

import pandas as pd
import pytest

from puckbench.metrics.tables.nearest_truth import nearest_truth
from puckbench.metrics.tables.noise_bits import noise_bits
from puckbench.metrics.tables.rate_deltas import bd_rate
from puckbench.report.reference_results import ReferenceResults, read_reference
from tests.support.pages import page

CODECS = "docs/explanation/codecs"
ANCHOR = "gpcc"
DISTANCES = (
    "accuracy, plane",
    "completeness, plane",
    "Chamfer, plane",
    "D2",
    "Chamfer, point",
    "D1",
)
SURFACE_CODECS = ("primitives", "gpcc_denoised", ANCHOR)
BITS_OF = ("puck", "jpegxl", "gpcc_predictive", "gpcc_angular", "gpcc", "draco")
SCENES = {"turns": "rooms", "streets": "streets"}
MODELS = ("none", "vlp16_measured", "vlp16")


def words(text: str) -> str:
    return " ".join(text.split())


def truth_of(evidence: ReferenceResults, anchor: str) -> pd.DataFrame:
    errors = evidence.table("scan_errors")
    assert errors is not None
    return nearest_truth(evidence.metrics, errors, anchor).set_index(
        ["dataset", "codec", "distance"]
    )


def interval(row: pd.Series, column: str, digits: int) -> str:
    value, low, high = (row[f"{column}{end}"] for end in ("", "_low", "_high"))
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def truth_lines(truth: pd.DataFrame) -> list[str]:
    """Lines of the table on the page of `primitives`."""
    lines = []
    for distance in DISTANCES:
        rows = [truth.loc[("rooms", codec, distance)] for codec in SURFACE_CODECS]
        shares = " | ".join(f"{interval(row, 'percent_of_scan', 0)} %" for row in rows)
        ratio = f"{rows[0]['bits_ratio']:.0f}" if rows[0]["reached"] > 8 else ""
        lines.append(f"| {distance} | {rows[0]['scan_mm']:.1f} mm | {shares} | {ratio} |")
    return lines


def noise_lines(noise: pd.DataFrame) -> list[str]:
    """Lines of the table on the page of the cost of noise."""
    lines = []
    for sets, scenes in SCENES.items():
        for model in MODELS:
            rows = noise[
                noise["dataset"].str.startswith(sets) & (noise["error_model"] == model)
            ].set_index("codec")
            entropy = f"{rows['noise_bits'].iloc[0]:.2f}"
            bits = " | ".join(f"{rows.loc[codec, 'grid_1_mm']:.2f}" for codec in BITS_OF)
            lines.append(f"| {scenes}, `{model}` | {entropy} | {bits} |")
    return lines


@pytest.fixture(scope="module")
def evidence() -> ReferenceResults:
    return read_reference("evidence")


def test_distances_to_the_truth_are_those_of_the_study(evidence: ReferenceResults) -> None:
    lines = page(f"{CODECS}/primitives.md").splitlines()
    assert [line for line in truth_lines(truth_of(evidence, ANCHOR)) if line not in lines] == []


def test_smoothed_turns_are_as_near_as_the_page_says(evidence: ReferenceResults) -> None:
    truth, text = truth_of(evidence, ANCHOR), words(page(f"{CODECS}/puck.md"))
    for dataset in ("turns_measured", "streets_measured"):
        row = truth.loc[(dataset, "puck_smoothed", "accuracy, plane")]
        assert f"{interval(row, 'percent_of_scan', 0)} %" in text


def test_ratios_of_bits_are_those_of_the_study(evidence: ReferenceResults) -> None:
    text = words(page(f"{CODECS}/primitives.md"))
    for anchor in (ANCHOR, "gpcc_denoised"):
        truth = truth_of(evidence, anchor)
        for distance in ("accuracy, plane", "Chamfer, plane"):
            row = truth.loc[("rooms", "primitives", distance)]
            assert interval(row, "bits_ratio", 0) in text, (anchor, distance)


def test_bits_of_noise_are_those_of_the_study(evidence: ReferenceResults) -> None:
    clouds = evidence.table("clouds")
    assert clouds is not None
    noise = noise_bits(evidence.metrics, clouds)
    text = page("docs/explanation/noise_cost.md")
    assert [line for line in noise_lines(noise) if line not in text.splitlines()] == []
    rows = noise.set_index(["dataset", "codec"])
    shares = [
        row["noise_bits"] / row["grid_1_mm"]
        for row in (rows.loc[(f"{sets}_measured", "puck")] for sets in SCENES)
    ]
    assert f"{shares[0]:.0%} in rooms, {shares[1]:.0%} in streets".replace("%", " %") in text
    for codec in ("puck", "gpcc", "gpcc_predictive", "gpcc_angular"):
        added = rows.loc[("turns_measured", codec)]
        assert interval(added, "added_grid_1_mm", 1) in words(text), codec


@pytest.mark.parametrize("codec", ["pcgcv1_plus", "pcgcv2_plus"])
def test_rate_deltas_are_those_of_the_default_run(codec: str) -> None:
    results = read_reference("default")
    rows = bd_rate(results.metrics, ANCHOR, ["d1_psnr"]).set_index(["dataset", "codec"])
    row = rows.loc[("objects", codec)]
    text = words(page(f"{CODECS}/{codec}.md"))
    delta = f"{row['bd_rate_percent']:.0f}".replace("-", "\N{MINUS SIGN}")
    assert (
        f"{delta} % on {row['compared']} of the {row['clouds']} objects of the default run" in text
    )
