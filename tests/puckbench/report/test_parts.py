"""The parts of the report: escaped markup, captions, tables, curves, clouds, pictures."""

from __future__ import annotations

import base64
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from markupsafe import Markup
from PIL import Image

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.rates import rates_of
from puckbench.codecs.registry import CODECS
from puckbench.figures.plot_styles import _OTHER_MARKERS, codec_style
from puckbench.figures.style import FigureStyle
from puckbench.planning.plan import spread_out
from puckbench.planning.workflow import Workflow
from puckbench.report.bd_rate_text import delta_text
from puckbench.report.build import TableShown, build_page
from puckbench.report.captions import caption_html
from puckbench.report.contents import Contents
from puckbench.report.findings import UseRow, findings, ranking_text
from puckbench.report.page import whole_page
from puckbench.report.pictures import MOST_BYTES, embedded
from puckbench.report.plot_data import plot_payload
from puckbench.report.run_record import RunRecord, duration_text
from puckbench.report.tables import MOST_ROWS, table_html
from puckbench.report.viewer_data import (
    ViewerCloud,
    cloud_payload,
    decoded_for_viewer,
    error_range,
    example_payload,
    levels,
    original_for_viewer,
    points_per_cloud,
    subsample_points,
)
from puckbench.results.columns import column_named, unit_in_frames
from puckbench.tables.cells import cell_text
from puckbench.tables.rate_deltas import bd_rate, bd_rate_pairs
from puckbench.tables.uses import uses


def test_text_and_attributes_are_escaped_and_markup_is_not() -> None:
    made = table_html(pd.DataFrame({"a < b & c": ["<i>"]}), 'x"<>.csv')
    assert ">A &lt; b &amp; c<small></small></th>" in made
    assert "<td>&lt;i&gt;</td>" in made
    assert '<a href="x&#34;&lt;&gt;.csv">CSV</a>' in made
    shown = TableShown("a", "<b>", table_html(pd.DataFrame({"x": [1]})), Markup("<p>c</p>"))
    page = whole_page(title="", record={}, parts={"tables": ""}, shown={"tables": [shown]}, data={})
    assert "<summary>&lt;b&gt;</summary>\n<p>c</p>\n<div class=" in page


def test_captions_have_paragraphs_code_and_emphasis_alone() -> None:
    made = caption_html("Columns ``a_b`` are *squared*,\n2 * 3 < 7.\n\nNext <b>.\n")
    expected = "<p>Columns <code>a_b</code> are <em>squared</em>, 2 * 3 &lt; 7.</p>"
    assert made == expected + "<p>Next &lt;b&gt;.</p>"


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.23456, "1.235"), (123456.7, "123457"), (0.0, "0"), (np.nan, ""), (pd.NA, ""), (7, "7")],
)
def test_cells_have_four_digits_and_nothing_where_a_value_is_missing(
    value: object, text: str
) -> None:
    assert cell_text(value) == text


def test_a_long_table_is_cut_and_says_so() -> None:
    table = pd.DataFrame({"cloud": [f"c{n}" for n in range(MOST_ROWS + 1)], "cd_plane": 1.5})
    made = table_html(table, "tables/x.csv")
    assert made.count("<tr>") == MOST_ROWS + 1
    assert f"The first {MOST_ROWS:,} of {MOST_ROWS + 1:,} rows." in made
    assert 'href="tables/x.csv"' in made


def test_quantiles_are_marked_where_their_median_stands_beside_them() -> None:
    made = table_html(pd.DataFrame({"bpp": [1.0], "bpp_q25": [0.5], "other_q25": [1.0]}))
    assert made.count('class="number spread"') == 2  # heading and cell of bpp_q25


def _metrics() -> pd.DataFrame:
    rows = [
        {"dataset": "set", "cloud": c, "codec": "draco", "rate": rate, "bpp": b, "cd_plane": d}
        for rate in ("r10", "r2")
        for c, b, d in zip("abcdef", range(1, 7), [4, 8, 12, 16, 20, np.nan], strict=True)
    ]
    return pd.DataFrame(rows).assign(repeats=3, mine=range(12), points_in=9)


def test_curves_are_quartiles_over_clouds_in_the_order_of_the_rates() -> None:
    made = plot_payload(_metrics(), FigureStyle(colours={"draco": "red"}))
    assert [cell["rate"] for cell in made["cells"]] == ["r2", "r10"]
    assert made["cells"][0]["values"]["bpp"] == [2.25, 3.5, 4.75]
    assert made["cells"][0]["values"]["cd_plane"] == [8.0, 12.0, 16.0]
    assert made["codecs"][0]["colour"] == "#ff0000"


def test_fewer_than_six_clouds_have_no_quartiles() -> None:
    rows = _metrics()
    made = plot_payload(rows[rows["cloud"] != "a"], FigureStyle())
    assert made["cells"][0]["values"]["bpp"] == [4.0] * 3
    assert made["cells"][0]["values"]["cd_plane"] == [14.0] * 3


def test_curves_show_what_differs_between_rates_and_not_what_describes_the_cloud() -> None:
    made = plot_payload(_metrics(), FigureStyle())
    assert [metric["name"] for metric in made["metrics"]] == ["cd_plane", "mine"]


@pytest.mark.parametrize(
    ("column", "label"),
    [
        ("truth_cd_plane", "Chamfer distance, point to plane, to the true surface (grid units²)"),
        ("hausdorff_point_m", "Hausdorff distance, point to point (m)"),
        ("encode_s_max", "Encoding time, most of the repetitions (s)"),
        ("d2_psnr", "PSNR D2, point to plane (dB)"),
        ("of_ones_own", "Of ones own"),
        ("of_ones_own_mm", "Of ones own (mm)"),
    ],
)
def test_columns_have_words_and_units(column: str, label: str) -> None:
    assert column_named(column).label == label


def test_coordinates_come_back_within_half_a_step() -> None:
    rng = np.random.default_rng(1)
    cloud = PointCloud(rng.uniform([0, 10, -5], [1, 30, -4.9], (500, 3)))
    made = cloud_payload(original_for_viewer(cloud, 1000))
    steps = np.frombuffer(base64.b64decode(made["xyz"]), "<u2").reshape(-1, 3)
    back = np.array(made["low"]) + steps / 65535 * np.array(made["extent"])
    assert (np.abs(back - cloud.xyz) <= np.array([1, 20, 0.1]) * 0.51 / 65535 + 1e-5).all()


def test_errors_are_distances_to_the_nearest_point_in_metres() -> None:
    original = PointCloud(np.zeros((1, 3)) + 100.0, about={"scale": 10.0})
    ((_, _, shown),) = decoded_for_viewer(original, [("c", "r", np.array([[100.0, 103, 104]]))], 10)
    assert shown.errors is not None
    np.testing.assert_allclose(shown.errors, [0.5])


def test_levels_fall_by_254_over_the_range() -> None:
    errors = np.array([2.0, 1.0, 0.1, 0.001, 0.0009, 0.0])
    assert levels(errors, 0.001, 1.0).tolist() == [255, 255, 170, 1, 0, 0]
    assert levels(np.zeros(3), 0.0, 0.0).tolist() == [0, 0, 0]


def _with_errors(*errors: float) -> ViewerCloud:
    return ViewerCloud(np.zeros((len(errors), 3)), len(errors), np.array(errors))


def test_the_range_of_colours_holds_a_codec_s_errors_at_all_rates() -> None:
    low, high = error_range([_with_errors(0.02, 0.03), _with_errors(0.5, 0.9)])
    assert 0.02 <= low < 0.03
    assert 0.8 < high <= 0.9
    low, high = error_range([_with_errors(*[1e-9] * 50, 0.0, *[1.0] * 50)])
    assert low == pytest.approx(high / 1000)
    low, high = error_range([_with_errors(0.1, 0.1)])
    assert (low, high) == pytest.approx((0.05, 0.1), rel=0.01)


def test_an_example_without_errors_has_no_range() -> None:
    cloud = PointCloud(np.arange(30.0).reshape(10, 3))
    decoded = decoded_for_viewer(cloud, [("c", "r", cloud.xyz)], 10)
    made = example_payload(original_for_viewer(cloud, 10), decoded, in_metres=False)
    assert made["ranges"] == {"c": [0, 0]}
    assert made["decoded"][0]["quantiles"] == [0, 0]


def test_clouds_are_subsampled_alike_each_time_and_kept_whole_when_small() -> None:
    points = np.arange(300.0).reshape(100, 3)
    chosen = subsample_points(points, 40, "draco", "r1")
    assert len(np.unique(chosen, axis=0)) == 40
    np.testing.assert_array_equal(chosen, subsample_points(points, 40, "draco", "r1"))
    assert subsample_points(points, 100, "x") is points


def test_many_clouds_have_fewer_points_each() -> None:
    assert points_per_cloud(20_000, 10, 8.0) == 20_000
    assert 16_000 < points_per_cloud(20_000, 52, 8.0) < 17_000


def test_a_wide_figure_is_narrowed_and_the_same_bytes_give_the_same() -> None:
    rng = np.random.default_rng(2)
    buffer = io.BytesIO()
    noise = rng.integers(0, 255, (900, 2000, 3), dtype=np.uint8)
    Image.fromarray(noise).save(buffer, format="PNG")
    made = embedded(buffer.getvalue(), "noise.png")
    assert (made.width, made.height) == (800, 360)
    assert made == embedded(buffer.getvalue(), "noise.png")
    assert len(made.png) < MOST_BYTES


def test_a_figure_that_is_no_picture_is_named() -> None:
    with pytest.raises(InputError, match=r"x\.png: not a readable picture"):
        embedded(b"no", "x.png")


def test_contents_go_to_json_and_back() -> None:
    value = {"title": "t", "examples": [{"kind": "raw", "dataset": "d", "cloud": "c"}]}
    value["examples"][0] |= {"original": "a.ply", "decoded": {"draco": {"r1": "b.ply"}}}
    contents = Contents.from_json(value)
    assert contents.files() == ["a.ply", "b.ply"]
    assert Contents.from_json(json.loads(json.dumps(contents.as_json()))) == contents


def test_contents_name_what_they_do_not_know() -> None:
    with pytest.raises(InputError, match=r"contents of the report: .*'figurs'"):
        Contents.from_json({"figurs": {}})


@pytest.mark.parametrize(
    ("count", "expected"), [(1, ["c"]), (2, ["a", "e"]), (3, ["a", "c", "e"]), (9, list("abcde"))]
)
def test_rates_are_spread_from_the_first_to_the_last(count: int, expected: list[str]) -> None:
    assert spread_out(list("abcde"), count) == expected


def test_scripts_and_style_name_no_address_to_fetch() -> None:
    folder = Path(__file__).parents[3] / "src" / "puckbench" / "report" / "assets"
    texts = [path.read_text() for path in folder.iterdir()]
    assert len(texts) > 5
    for text in texts:
        assert "@import" not in text
        assert "url(" not in text
        assert "fetch(" not in text


def test_the_page_draws_the_marker_of_every_codec() -> None:
    folder = Path(__file__).parents[3] / "src" / "puckbench" / "report" / "assets"
    script = (folder / "markers.js").read_text(encoding="utf-8")
    table = script[script.index("const MARKERS = {") : script.index("/** A marker of a radius")]
    original = set(re.findall(r"""(?:^ |[,{])\s*"?([^\s":,(\[]+)"?: """, table, flags=re.MULTILINE))
    drawn = {codec_style(name).marker for name in CODECS.names()} | set(_OTHER_MARKERS)
    assert drawn <= original


def test_the_default_run_shows_all_its_figures_and_every_codec_at_three_rates() -> None:
    root = Path(__file__).parents[3]
    config = yaml.safe_load((root / "config" / "config.yaml").read_text())
    bench = Workflow(config)
    contents = bench.outputs.report_contents
    assert set(contents.figures) == set(bench.outputs.figures)
    assert {"summary", "clouds", "bd_rate", "thesis_numbers"} <= set(contents.tables)
    assert [example.kind for example in contents.examples] == list(config["figures"]["examples"])
    for example in contents.examples:
        frame = "metric" if example.kind == "spin" else "scaled"
        coding = {name for name, codec in bench.plan.opened.items() if rates_of(codec, frame)}
        assert set(example.decoded) == coding
        assert {len(rates) for rates in example.decoded.values()} == {3}
    assert contents.examples[0].original == "results/clouds/objects/airplane_02.ply"


def test_the_record_of_a_run_is_read_from_the_costs_of_its_jobs() -> None:
    cost = {"wall_s": 10.0, "processor_s": 3700.0}
    ends = ("2026-02-28T23:59:50+00:00", "2026-02-28T23:59:55+00:00", "2026-03-02T08:00:00+00:00")
    costs = [{**cost, "ended": end, "commit": name} for end, name in zip(ends, "aab", strict=True)]
    record = RunRecord.of([*reversed(costs), cost])
    assert (record.jobs, record.busy_s, record.commits) == (4, 25.0, ("a", "b"))
    assert record.facts() == {
        "Date": "28 February 2026 to 2 March 2026",
        "Duration": "25 s, 4 h 7 min of processor time in 4 jobs",
        "Commit": "a, b",
    }


def test_of_logs_that_tell_no_date_the_record_has_the_work_alone() -> None:
    record = RunRecord.of([{"wall_s": 1.0, "processor_s": 2.0}])
    assert record.facts() == {"Duration": "2 s of processor time in 1 job"}
    assert RunRecord.of([]).facts() == {}


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (12.4, "12 s"), (89, "89 s"), (99, "99 s"), (100, "2 min"), (400, "7 min"),
        (5340, "89 min"), (5940, "99 min"), (6000, "1 h 40 min"), (12_600, "3 h 30 min"),
    ],
)  # fmt: skip
def test_a_duration_is_told_in_two_units_at_most(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def _two_codecs(**columns: list[float]) -> pd.DataFrame:
    names = {"dataset": "rooms", "cloud": "a", "codec": ["draco", "gpcc"], "rate": "r1"}
    return pd.DataFrame({**names, "bpp": [1.0, 2.0], **columns})


def _delta(**columns: Any) -> dict[str, Any]:
    """A row of the table of BD-rates."""
    row = {"dataset": "rooms", "metric": "d1_psnr", "codec": "draco", "anchor": "gpcc"}
    values = {"": -50.0, "_low": -60.0, "_high": -40.0, "_least": -70.0, "_most": -5.0}
    values = {f"bd_rate_percent{end}": value for end, value in values.items()}
    counts = {"clouds": 6, "compared": 6, "scenes": 6, "verdict": "better"}
    counts |= {"no_common_range": 0, "little_overlap": 0, "too_few_points": 0}
    return {**row, **values, **counts, **columns}


NO_INTERVAL = {"bd_rate_percent_low": np.nan, "bd_rate_percent_high": np.nan}
FEW = {**NO_INTERVAL, "verdict": "no verdict"}
NONE = {**FEW, "bd_rate_percent": np.nan, "compared": 0, "scenes": 0}


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({}, "−50.0 % (−60.0 % to −40.0 %, 6 scenes, better)"),
        (
            {"clouds": 12, "compared": 9},
            "−50.0 % (−60.0 % to −40.0 %, 6 scenes, 9 of 12 clouds, better)",
        ),
        (
            {**FEW, "scenes": 5, "compared": 5},
            "−50.0 % (−70.0 % to −5.0 %, 5 scenes, 5 of 6 clouds, no verdict)",
        ),
        (
            {**FEW, "scenes": 1, "clouds": 1, "compared": 1}
            | {"bd_rate_percent_least": -50.0, "bd_rate_percent_most": -50.0},
            "−50.0 % (one scene, no verdict)",
        ),
        ({**NONE, "no_common_range": 1, "little_overlap": 2}, "overlap below half"),
        ({**NONE, "too_few_points": 3}, "fewer than 4 lossy rates"),
        (NONE, "no common range"),
    ],
)
def test_a_bd_rate_stands_with_its_interval_scenes_and_verdict(
    change: dict[str, Any], text: str
) -> None:
    row = _delta(**change)
    assert delta_text(row).replace("\xa0", " ") == text
    of_a_file = {name: "" if pd.isna(value) else str(value) for name, value in row.items()}
    assert delta_text(of_a_file).replace("\xa0", " ") == text


def _curves(**ratios: list[float]) -> pd.DataFrame:
    """Codecs with ratios of their rates in each scene, on curves of 60 to 90 dB."""
    rows = [
        {"dataset": "rooms", "cloud": f"c{cloud}", "codec": codec, "rate": f"r{r}",
         "bpp": ratio * 2.0**r, "d1_psnr": 60.0 + 6 * r, "points_in": 1000}
        for codec, values in ratios.items()
        for cloud, ratio in enumerate(values)
        for r in range(6)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def _ranking(metrics: pd.DataFrame) -> str:
    pairs = bd_rate_pairs(metrics, "gpcc", ["d1_psnr"])
    codecs, clouds = list(dict.fromkeys(metrics["codec"])), metrics["cloud"].nunique()
    return ranking_text(pairs, codecs, clouds, FigureStyle()).replace("\xa0", " ")


DRACO = [0.5, 0.49, 0.5, 0.52, 0.5, 0.49]
CLOSE = [0.5, 0.52, 0.48, 0.5, 0.51, 0.5]
WORSE = [0.6, 0.62, 0.63, 0.6, 0.61, 0.6]
NOBODY = "no codec is better than every other; not beaten: "


def test_the_best_is_named_with_its_closest_rival() -> None:
    """A ratio of 0.82 to LAZ, whose interval excludes 1, and half of G-PCC's bits."""
    told = _ranking(_curves(gpcc=[1.0] * 6, draco=DRACO, laz=WORSE))
    assert told.startswith("Draco needs the fewest bits; next LAZ: −18.0 % (")
    assert told.endswith("6 scenes, better)")


def test_an_interval_that_includes_zero_has_no_winner() -> None:
    told = _ranking(_curves(gpcc=[1.0] * 6, draco=DRACO, laz=CLOSE))
    assert told == f"{NOBODY}Draco, LAZ"


def test_five_scenes_have_no_winner() -> None:
    told = _ranking(_curves(gpcc=[1.0] * 5, draco=DRACO[:5]))
    assert told == "no verdict: fewer than 6 scenes with comparable curves"


def test_a_codec_that_is_not_comparable_in_every_scene_wins_nothing() -> None:
    """Of seven scenes LAZ has no common range with the others in one, or no result."""
    metrics = _curves(gpcc=[1.0] * 7, draco=[*DRACO, 0.5], laz=[*WORSE, 0.6])
    assert _ranking(metrics).startswith("Draco needs the fewest bits")
    apart = (metrics["codec"] == "laz") & (metrics["cloud"] == "c3")
    told = f"{NOBODY}Draco; 2 of 3 pairs not comparable on all clouds"
    far = metrics.assign(d1_psnr=metrics["d1_psnr"] + 100 * apart)
    assert _ranking(far) == told
    assert _ranking(metrics[~apart]) == told


def test_a_codec_that_met_only_some_of_the_others_wins_nothing() -> None:
    """Draco beats LAZ, and has no scene in common with G-PCC."""
    metrics = _curves(gpcc=[1.0] * 12, draco=[0.5] * 12, laz=[0.6] * 12)
    is_late = metrics["cloud"].str[1:].astype(int) >= 6
    metrics = metrics[(metrics["codec"] == "laz") | (is_late == (metrics["codec"] == "gpcc"))]
    assert _ranking(metrics).startswith(f"{NOBODY}Draco")


def test_nobody_wins_against_a_codec_without_a_curve_or_on_a_part_of_the_clouds() -> None:
    metrics = _curves(gpcc=[1.0] * 6, draco=DRACO)
    exact = metrics[metrics["codec"] == "draco"].head(1).assign(codec="laz", d1_psnr=np.nan)
    assert _ranking(pd.concat([metrics, exact.assign(lossless=True)])).startswith(NOBODY)
    late = _curves(gpcc=[1.0] * 10)[
        lambda rows: rows["cloud"].isin([f"c{n}" for n in range(6, 10)])
    ]
    assert _ranking(pd.concat([metrics, late])).startswith(NOBODY)


def test_lossless_ranges_stay_in_the_comparison() -> None:
    metrics = _curves(gpcc=[1.0] * 6, draco=DRACO)
    ranges = 10 ** (-metrics["d1_psnr"] / 20)
    exact = metrics[(metrics["rate"] == "r0")].assign(codec="laz", range_rms_mm=0.0, lossless=True)
    both = pd.concat([metrics.assign(range_rms_mm=ranges, lossless=False), exact])
    both = both.drop_duplicates(["cloud", "codec", "rate"])
    pairs = bd_rate_pairs(both, "gpcc", ["range_rms_mm"])
    assert set(pairs["codec"]) == {"gpcc", "draco", "laz"}
    assert "needs the fewest bits" not in ranking_text(
        pairs, ["gpcc", "draco", "laz"], 6, FigureStyle()
    )


def test_findings_have_the_bd_rates_of_all_codecs() -> None:
    metrics = _curves(gpcc=[1.0] * 6, draco=DRACO, laz=WORSE)
    tables = {
        make.__name__: make(metrics, "gpcc", ["d1_psnr"]) for make in (bd_rate, bd_rate_pairs)
    }
    found = findings(metrics, tables, FigureStyle())
    (rooms,) = found.datasets
    assert (found.anchor, rooms.title, rooms.clouds) == ("G-PCC", "Rooms", 6)
    cells = rooms.columns["BD-rate, D1"]
    assert (cells["gpcc"].text, cells["gpcc"].note) == ("0 %", "reference")
    assert cells["draco"].text.replace("\xa0", " ") == "−50.0 %"
    assert cells["draco"].note.endswith("6 scenes, better")
    assert rooms.statements["BD-rate, D1"].startswith("Draco needs the fewest bits")
    assert findings(metrics, {}, FigureStyle()).datasets == ()


def _use(codec: str, **columns: Any) -> dict[str, Any]:
    row = {"dataset": "rooms", "use": "within_5_mm", "codec": codec, "bpp": 2.0, "error_mm": 5.0}
    row |= {"largest_mm": 15.0, "seconds": 0.5, "ratio": 1.0, "ratio_low": np.nan}
    return {**row, "ratio_high": np.nan, "verdict": "undecided", "scenes": 6, **columns}


def _use_row(*rows: dict[str, Any]) -> UseRow:
    (row,) = findings(_two_codecs(), {"uses": pd.DataFrame(rows)}, FigureStyle()).uses
    return row


RIVAL = {"ratio": 1.5, "ratio_low": 1.2, "ratio_high": 1.9, "verdict": "worse"}
PART = {"ratio": np.nan, "verdict": "no verdict", "scenes": 4}


def test_findings_name_the_codec_of_fewest_bits_that_odometry_needs() -> None:
    drive = {"dataset": "street", "odometry": "kiss_icp", "unit": "%", "trajectories": 8}
    drive |= {"undecoded": 0.4, "margin": 0.1, "value": 0.45}
    drive |= {"difference": 0.05, "low": 0.02, "high": 0.08}
    table = pd.DataFrame(
        [
            {**drive, "codec": "draco", "bits": 3.0, "verdict": "not worse"},
            {**drive, "codec": "gpcc", "bits": 0.8, "verdict": "not worse"},
            {**drive, "codec": "puck", "bits": np.nan, "verdict": "no rate suffices"},
            {**drive, "dataset": "yard", "codec": "gpcc", "bits": np.nan, "verdict": "no verdict"},
        ]
    )
    street, yard = findings(None, {"odometry_bits": table}, FigureStyle()).uses
    assert (street.clouds, street.codec, street.bits, street.scenes) == (
        "Street",
        "G-PCC",
        "0.8",
        "8",
    )
    assert street.verdict == "coding adds 0.050 (0.020 to 0.080) % to 0.4 %"
    assert (yard.codec, yard.bits, yard.verdict) == ("\N{EN DASH}", "\N{EN DASH}", "no verdict")


def test_the_best_for_a_use_has_its_numbers_and_its_rival() -> None:
    row = _use_row(_use("draco", verdict="fewest bits"), _use("gpcc", **RIVAL))
    assert (row.use, row.clouds, row.codec) == ("RMS error of at most 5 mm (D1)", "Rooms", "Draco")
    numbers = row.bits, row.error, row.largest, row.seconds, row.scenes
    assert [text.replace("\xa0", " ") for text in numbers] == ["2", "5 mm", "15 mm", "0.5 s", "6"]
    assert row.verdict == "fewest bits; G-PCC has 1.50 (1.20 to 1.90) times the bits"
    assert row.is_decided
    nearest = _use("draco", verdict="nearest", use="nearest", seconds=np.nan)
    row = _use_row(nearest, _use("gpcc", **RIVAL, use="nearest"))
    assert row.verdict == "nearest; G-PCC has 1.50 (1.20 to 1.90) times the error"
    assert row.seconds == "not timed"


@pytest.mark.parametrize(
    ("others", "verdict"),
    [
        ([_use("gpcc"), _use("laz", **RIVAL)], "undecided; then G-PCC"),
        ([_use("gpcc", verdict="not worse"), _use("laz")], "undecided; then G-PCC, LAZ"),
        ([_use("gpcc", **RIVAL), _use("laz", **PART)], "undecided; in some scenes alone LAZ"),
        ([_use("laz", **PART)], "the only one in every scene; in some scenes alone LAZ"),
        ([], "the only one"),
    ],
)
def test_without_a_winner_those_near_it_are_named(
    others: list[dict[str, Any]], verdict: str
) -> None:
    row = _use_row(_use("draco"), *others)
    assert (row.verdict, row.is_decided) == (verdict, False)


def test_who_serves_some_scenes_is_not_named_the_best() -> None:
    row = _use_row(_use("draco", **PART), _use("gpcc", **PART))
    assert (row.verdict, row.is_decided) == ("no codec in every scene", False)


def test_lossless_rates_are_named() -> None:
    metrics = _two_codecs(lossless=[True, False])
    assert findings(metrics, {}, FigureStyle()).lossless == "Draco r1 (1 cloud)"
    assert findings(_two_codecs(), {}, FigureStyle()).lossless == ""


def test_a_table_without_rows_is_left_out(tmp_path: Path) -> None:
    """No codec serves a use."""
    metrics = _curves(gpcc=[1.0], draco=[0.5])
    metrics.to_csv(tmp_path / "metrics.csv", index=False)
    uses(metrics).to_csv(tmp_path / "uses.csv", index=False)
    pd.DataFrame({"mine": [1]}).to_csv(tmp_path / "mine.csv", index=False)
    tables = {name: str(tmp_path / f"{name}.csv") for name in ("uses", "mine")}
    contents = Contents(metrics=str(tmp_path / "metrics.csv"), tables=tables)
    page = build_page(contents, {}, tmp_path)
    assert 'id="table-mine"' in page
    assert 'id="table-uses"' not in page
    assert "Which codec for what" not in page


def test_figures_are_ordered_by_number_whatever_the_order_they_are_given_in(
    tmp_path: Path,
) -> None:
    names = ("truth_rd", "fig_5_10", "fig_6_6", "fig_5_2")
    for name in names:
        Image.new("RGB", (20, 10)).save(tmp_path / f"{name}.png")
    contents = Contents(figures={name: str(tmp_path / f"{name}.png") for name in names})
    page = build_page(contents, {}, tmp_path)
    assert re.findall(r'id="figure-(\w+)"', page) == ["fig_5_2", "fig_5_10", "fig_6_6", "truth_rd"]


@pytest.mark.parametrize(
    ("column", "others", "heading"),
    [
        ("bpp_q25", ["bpp"], ("Bits per point, 25 %", "bpp")),
        ("density_q25_m2", [], ("Density, 25 %", "1/m²")),
        ("spread_q25_m2", [], ("Spread, 25 %", "1/m²")),
        ("thing_least", [], ("Thing least", "")),
        ("thing_half_m", ["thing_m"], ("Thing, half the interval", "m")),
        ("thing_half_m", [], ("Thing half", "m")),
        ("truth_d2_rms_m", [], (column_named("truth_d2_rms_m").words, "m")),
    ],
)
def test_headings_put_names_into_words(
    column: str, others: list[str], heading: tuple[str, str]
) -> None:
    described = column_named(column, others)
    assert (described.words, described.unit) == heading


def test_columns_have_words_and_data_sets_and_codecs_their_titles() -> None:
    table = pd.DataFrame(
        {"dataset": ["s3dis"], "codec": ["gpcc"], "clouds": [2], "bd_rate_percent": [1.0]}
    )
    style = FigureStyle(dataset_titles={"s3dis": "S3DIS"})
    made = table_html(table.assign(bd_rate_percent_low=0.5, thing_m=1.0), style=style)
    heads = re.findall(r'<th scope="col" title="(\w+)"[^>]*>([^<]+)<small>([^<]*)</small>', made)
    assert heads == [
        ("dataset", "Data set", ""),
        ("codec", "Codec", ""),
        ("bd_rate_percent", "BD-rate", "%"),
        ("bd_rate_percent_low", "BD-rate, interval from", "%"),
        ("thing_m", "Thing", "m"),
        ("clouds", "Clouds", ""),
    ]
    assert "<td>S3DIS</td><td>G-PCC</td>" in made


def test_units_are_those_of_the_clouds_frames() -> None:
    assert unit_in_frames("grid units²", {"scaled"}) == "grid units²"
    assert unit_in_frames("grid units²", {"metric"}) == "m²"
    assert unit_in_frames("grid units", {"metric", "scaled"}) == "grid units or m"
    assert unit_in_frames("dB", {"metric"}) == "dB"


def test_a_heading_names_the_units_of_all_rows() -> None:
    table = pd.DataFrame({"dataset": ["a", "b"], "cd_plane": [1.0, 2.0], "frame": [None, "metric"]})
    assert "<small>grid units² or m²</small>" in table_html(table)
    assert "<small>m²</small>" in table_html(table[1:])
    assert "<small>grid units²</small>" in table_html(table.drop(columns="frame"))


def test_panels_in_grid_units_and_in_metres_have_units_of_their_own() -> None:
    metrics = _metrics()
    spins = metrics.assign(dataset="spins", frame="metric")
    made = plot_payload(pd.concat([metrics, spins], ignore_index=True), FigureStyle())
    frames = {dataset["name"]: dataset["frame"] for dataset in made["datasets"]}
    assert frames.pop("spins") == "metric"
    assert set(frames.values()) == {"scaled"}
    (distance,) = [metric for metric in made["metrics"] if metric["name"] == "cd_plane"]
    assert distance["units"] == {"scaled": "grid units²", "metric": "m²"}
