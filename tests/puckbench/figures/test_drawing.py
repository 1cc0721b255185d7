"""The figures themselves: what is on them, that nothing vanishes, and that bytes repeat."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from PIL import Image

import puckbench
from cloud_files.clouds import write_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import returns_file, write_firings
from pointkit.tables import read_table
from puckbench.figures.drawing import draw_files, lay_out, save_figure
from puckbench.figures.example_clouds import round_length
from puckbench.figures.panels import add_rows_legend, label_rates, log_limits
from puckbench.figures.plot_styles import codec_style
from puckbench.figures.registry import FIGURES, figure_entries, figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.metrics.timing import unranked_codecs
from puckbench.tables.odometry_differences import odometry_differences
from tests.puckbench.tables.test_perception import losses
from tests.puckbench.tables.test_perception import metrics as labelled_metrics
from tests.support.figures_lookalike import (
    CD_MEDIANS,
    SCALE,
    clouds_table,
    metrics_table,
    recovery_table,
    room_cloud,
    scan_errors_table,
    sweeps_clouds_table,
    sweeps_scan_errors_table,
    sweeps_table,
)
from tests.support.returns import recorded

OWN = [name for name in FIGURES.names() if FIGURES.module_of(name).startswith("puckbench.")]
FROM_METRICS = [
    name
    for name, entry in figure_entries().items()
    if name in OWN
    and not entry.instead_of
    and entry.inputs == ("metrics",)
    and entry.frame == "scaled"
]


def draw(name: str, style: FigureStyle | None = None, **inputs: Any) -> Figure:
    style = style or FigureStyle()
    with style.context():
        figure: Figure = figure_entry(name).draw(**inputs, style=style)
    return figure


def lines(axes: Axes) -> dict[str, np.ndarray]:
    """Colour -> drawn points (n, 2)."""
    return {line.get_color(): line.get_xydata() for line in axes.get_lines()}


REFERENCE_DRIVES = (
    Path(puckbench.__file__).parent / "report" / "reference_drives" / "drives.parquet"
)


@pytest.fixture(scope="module")
def input_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("inputs")
    files = {"metrics": folder / "metrics.csv", "clouds": folder / "clouds.parquet"}
    mixed = pd.concat([metrics_table(3), sweeps_table(3)])
    mixed.to_csv(files["metrics"], index=False)
    pd.concat([clouds_table(3), sweeps_clouds_table(3)]).to_parquet(files["clouds"])
    tables = {
        "scan_errors": pd.concat([scan_errors_table(), sweeps_scan_errors_table()]),
        "recovery": recovery_table(),
    }
    tables["drives"] = pd.read_parquet(REFERENCE_DRIVES)
    tables["odometry_differences"] = odometry_differences(tables["drives"])
    tables["perception_losses"] = losses(metrics=labelled_metrics())
    for name, table in tables.items():
        files[name] = folder / f"{name}.parquet"
        table.to_parquet(files[name])
    for version, noise_m in {"object": 0.0, "raw": 0.0, "clean": 0.0, "noisy": 0.03}.items():
        files[f"example_{version}"] = folder / f"{version}.ply"
        write_cloud(files[f"example_{version}"], room_cloud(20_000, noise_m))
    files["example_spin"] = folder / "spin.ply"
    write_cloud(files["example_spin"], PointCloud(recorded().points(), about={"size": 0}))
    write_firings(returns_file(files["example_spin"]), recorded())
    return files


@pytest.mark.parametrize("name", ["room_scans", "point_counts", "truth_rd"])
def test_the_same_input_gives_the_same_bytes(
    name: str, input_files: dict[str, Path], tmp_path: Path
) -> None:
    style = FigureStyle(dpi=60)
    outputs = [tmp_path / f"{i}{suffix}" for i in "ab" for suffix in (".pdf", ".png")]
    draw_files(name, input_files, outputs[:2], style)
    draw_files(name, input_files, outputs[2:], style)
    pdf, png, pdf_again, png_again = (path.read_bytes() for path in outputs)
    assert (pdf, png) == (pdf_again, png_again)
    assert b"/Subtype /Type3" not in pdf
    assert not any(word in pdf + png for word in (b"CreationDate", b"Matplotlib"))


@pytest.mark.parametrize("name", OWN)
def test_every_figure_is_drawn_from_files(
    name: str, input_files: dict[str, Path], tmp_path: Path
) -> None:
    draw_files(name, input_files, [tmp_path / "figure.png"], FigureStyle(dpi=30))
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_a_figure_with_a_resolution_of_its_own_has_that_of_the_style(tmp_path: Path) -> None:
    style = FigureStyle(dpi=100)
    with style.context():
        save_figure(Figure(figsize=(2, 1), dpi=50), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (200, 100)


def test_medians_per_rate_are_those_of_the_table() -> None:
    table = metrics_table(clouds=301)
    panels = draw("medians_per_rate", metrics=table).axes
    assert len(panels) == 16
    noisy = FigureStyle().of_datasets(table["dataset"])["s3dis_noisy"].colour
    for codec, cd in zip(("draco", "gpcc", "pcgcv1", "pcgcv2"), panels[::4], strict=True):
        rates, medians = lines(cd)[noisy].T
        assert rates.tolist() == list(range(len(CD_MEDIANS["s3dis_noisy", codec])))
        np.testing.assert_allclose(medians, CD_MEDIANS["s3dis_noisy", codec], rtol=0.08)
        assert cd.get_title(loc="left") == codec_style(codec).title


@pytest.mark.parametrize("name", ["medians_per_rate", "spread"])
def test_an_axis_of_rates_is_one_codecs_own(name: str) -> None:
    table = metrics_table(2)
    table.loc[table["codec"] == "gpcc", "rate"] += "0mm"
    panels = draw(name, metrics=table).axes
    rows = [panels[first : first + 4] for first in range(0, 16, 4)]
    for codec, row in zip(("draco", "gpcc", "pcgcv1", "pcgcv2"), rows, strict=True):
        rates = sorted(set(table.loc[table["codec"] == codec, "rate"]))
        for axes in row:
            shown = [tick.get_text() for tick in axes.get_xticklabels()]
            assert shown == (rates if len(rates) * 4 <= 36 else [r[1:] for r in rates])


@pytest.mark.parametrize("name", FROM_METRICS)
@pytest.mark.parametrize("factor", [1.0, 1e-4, 1e4])
def test_every_point_lies_within_its_axes(name: str, factor: float) -> None:
    table = metrics_table(4)
    numbers = table.select_dtypes("number").columns
    table[numbers] *= factor
    for axes in draw(name, metrics=table).axes:
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        for x, y in (point for points in lines(axes).values() for point in points):
            assert left <= x <= right
            assert low <= y <= high


def test_limits_follow_the_data() -> None:
    assert log_limits(np.array([0.5, 20.0, 0.0, np.nan]), "bpp", FigureStyle()) == (
        pytest.approx(0.5 / 1.4),
        pytest.approx(20 * 1.4),
    )
    assert log_limits(np.array([0.0]), "bpp", FigureStyle()) == (0.1, 10.0)


def test_limits_of_the_style_widen_by_whole_decades_only_where_needed() -> None:
    style = FigureStyle(axis_ranges={"bpp": (0.1, 100.0)})
    assert log_limits(np.array([0.5, 20.0]), "bpp", style) == (0.1, 100.0)
    assert log_limits(np.array([0.003, 20.0]), "bpp", style) == (0.001, 100.0)
    assert log_limits(np.array([0.5, 4000.0, 0.0, np.nan]), "bpp", style) == (0.1, 10_000.0)
    assert log_limits(np.array([]), "bpp", style) == (0.1, 100.0)


def test_a_lossless_rate_is_a_tick_at_the_foot_and_no_point() -> None:
    table = metrics_table(1)
    table.loc[table["rate"] == "r8", "cd_plane"] = 0.0
    axes = draw("chamfer_rd", metrics=table).axes[0]
    vertical = [c for c in axes.collections if isinstance(c, LineCollection)]
    ticks = [c for c in vertical if c.get_transform() != axes.transData]
    bits = {float(path.vertices[0, 0]) for tick in ticks for path in tick.get_paths()}
    rows = table[(table["rate"] == "r8") & (table["dataset"] == "capod")]
    assert bits == set(rows["bpp"])
    assert len(bits) == 2  # Draco and G-PCC have an r8
    assert all((points[:, 1] > 0).all() for points in lines(axes).values())


def test_times_that_cannot_be_ranked_are_dotted() -> None:
    table = metrics_table(2)
    assert not unranked_codecs(table)
    table.loc[table["codec"] == "gpcc", "repeats"] = 1
    by_codec, by_panel = (
        draw("encoding_time", metrics=table),
        draw("medians_per_rate", metrics=table),
    )
    shown = {line.get_color(): line for line in by_codec.axes[0].get_lines()}
    for number, (codec, is_dotted) in enumerate((("draco", False), ("gpcc", True))):
        of_codec = [shown[codec_style(codec).colour], *by_panel.axes[4 * number + 2].get_lines()]
        for line in of_codec:
            assert (line.get_linestyle() == ":", line.get_marker() == "") == (is_dotted,) * 2
        assert all(line.get_linestyle() == "-" for line in by_panel.axes[4 * number].get_lines())
    for figure in (by_codec, by_panel):
        texts = [text.get_text() for text in figure.legends[0].get_texts()]
        assert any(text.startswith("not ranked") for text in texts)


def test_bars_are_quartiles_over_clouds_and_titles_count_these() -> None:
    table = metrics_table(6)
    figure = draw("chamfer_rd", metrics=table)
    axes = figure.axes[0]
    assert "quartiles over clouds" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert axes.get_title() == "Capod (n\xa0=\xa06)"
    rows = table[(table["dataset"] == "capod") & (table["codec"] == "draco")]
    quartiles = rows.groupby("rate")["cd_plane"].quantile(np.array([0.25, 0.75])).unstack()
    bars = [path.vertices[:, 1] for path in axes.collections[0].get_paths()]
    np.testing.assert_allclose(np.sort(bars, axis=0), np.sort(quartiles, axis=0))


def test_fewer_than_six_clouds_are_dots_and_have_no_bars() -> None:
    table = metrics_table(5)
    figure = draw("chamfer_rd", metrics=table)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "single clouds" in texts
    assert "quartiles over clouds" not in texts
    dots = [c.get_offsets() for c in figure.axes[0].collections]
    rows = table[(table["dataset"] == "capod") & (table["codec"] == "draco")]
    np.testing.assert_allclose(dots[0], rows[["bpp", "cd_plane"]])


def test_titles_count_scenes_if_these_are_fewer_than_clouds() -> None:
    table = metrics_table(6)
    scenes = table["cloud"].replace({f"cloud_{n}": f"scene_{n // 2}" for n in range(6)})
    axes = draw("chamfer_rd", metrics=table.assign(scene=scenes)).axes[0]
    assert axes.get_title() == "Capod (n\xa0=\xa06 of 3 scenes)"


def test_only_the_chosen_codecs_and_data_sets_are_drawn(
    input_files: dict[str, Path], tmp_path: Path
) -> None:
    chosen = {"codec": ["draco"], "dataset": ["capod"]}
    out = [tmp_path / "figure.svg"]
    draw_files("chamfer_rd", input_files, out, FigureStyle(), chosen)
    text = out[0].read_text()
    assert codec_style("draco").colour.lower() in text
    assert codec_style("gpcc").colour.lower() not in text
    with pytest.raises(InputError, match=r"no codec 'drako' in the tables .* did you mean 'draco'"):
        draw_files("chamfer_rd", input_files, out, FigureStyle(), {"codec": ["drako"]})


def test_colours_stay_when_a_codec_or_data_set_is_added_or_taken_away() -> None:
    table = metrics_table(2)
    added = table[table["codec"] == "draco"].assign(codec="a_new_codec")
    fewer = table[(table["codec"] != "draco") & (table["dataset"] != "capod")]
    before = set(lines(draw("chamfer_rd", metrics=table).axes[0]))
    after = set(lines(draw("chamfer_rd", metrics=pd.concat([added, table])).axes[0]))
    assert after - before == {FigureStyle().of_codec("a_new_codec").colour}
    assert before - after == set()
    alone = set(lines(draw("chamfer_rd", metrics=fewer).axes[0]))
    assert alone == before - {codec_style("draco").colour}


@pytest.mark.parametrize("name", FROM_METRICS)
def test_axes_say_what_they_show_and_in_which_unit(name: str) -> None:
    figure = draw(name, metrics=metrics_table(2))
    labels = [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()]
    labels = [figure.get_supylabel()] if figure.get_supylabel() else labels
    assert labels
    better = ", \N{LEFTWARDS ARROW} better"
    assert all(label.endswith((f"(grid units²){better}", f"(s){better}")) for label in labels)
    xlabels = {axes.get_xlabel() for axes in figure.axes} | {figure.get_supxlabel()}
    assert xlabels - {""} in ({f"Bits per point (bpp){better}"}, {"Compression rate of the codec"})


@pytest.mark.parametrize("datasets", [1, 3, 8])
def test_titles_and_labels_do_not_overlap(datasets: int) -> None:
    table = metrics_table(1)
    first = table[table["dataset"] == "s3dis_clean"]
    many = pd.concat(first.assign(dataset=f"some_long_data_set_{i}") for i in range(datasets))
    figure = draw("chamfer_rd", metrics=many)
    lay_out(figure)
    rows: dict[float, list[Any]] = {}
    for axes in figure.axes:
        extent = axes.title.get_window_extent()
        if axes.get_title():
            rows.setdefault(round(axes.get_position().y0, 3), []).append(extent)
    for titles in rows.values():
        assert all(a.x1 < b.x0 for a, b in pairwise(sorted(titles, key=lambda t: t.x0)))
    legend = figure.legends[0].get_window_extent()
    assert all(legend.y0 >= title.y1 for titles in rows.values() for title in titles)
    assert figure.get_size_inches()[0] == (3.5 if datasets == 1 else 7.16)


def test_a_data_set_without_values_keeps_its_panel_and_says_so() -> None:
    table = metrics_table(2)
    table.loc[table["dataset"] == "s3dis_raw", "cd_plane"] = np.nan
    panel = draw("chamfer_rd", metrics=table).axes[1]
    assert [text.get_text() for text in panel.texts] == ["no values"]


def test_truth_is_drawn_only_for_data_sets_that_have_it() -> None:
    panels = draw("truth_rd", metrics=metrics_table(12), scan_errors=scan_errors_table()).axes
    titles = [axes.get_title().replace("\n", " ") for axes in panels]
    assert [title.removeprefix("S3dis noisy: ") for title in titles] == [
        "to the scan (n\xa0=\xa012)",
        "to the truth (n\xa0=\xa012)",
    ]
    draco = codec_style("draco").colour
    scan, truth = (lines(axes)[draco][-1, 1] for axes in panels)
    assert scan < 1000 * 0.03**0.5 / SCALE
    assert 2.4**0.5 < truth * SCALE / 1000 < 2.5**0.5
    assert panels[0].get_ylabel() == "RMS distance (D2)\n(mm), \N{LEFTWARDS ARROW} better"


def own_errors(axes: Axes) -> list[float]:
    """Heights of the lines across a panel."""
    return [float(y[0]) for y in (line.get_ydata() for line in axes.get_lines()) if len(y) == 2]


@pytest.mark.parametrize(
    "name", ["truth_rd", "truth_rd_point", "truth_rd_hausdorff", "truth_accuracy"]
)
def test_the_scans_own_error_is_a_line_at_its_median_over_clouds(name: str) -> None:
    figure = draw(name, metrics=metrics_table(3), scan_errors=scan_errors_table())
    own_mm = 1000 * 2.4**0.5 / SCALE
    of_the_scan = [own_mm] if name == "truth_accuracy" else []
    drawn = [own_errors(axes) for axes in figure.axes]
    assert drawn == [pytest.approx(of_the_scan), pytest.approx([own_mm])]
    assert "the scan itself" in [text.get_text() for text in figure.legends[0].get_texts()]
    bpp, values = (figure.axes[0].get_shared_x_axes(), figure.axes[0].get_shared_y_axes())
    for axes in figure.axes[1:]:
        assert bpp.joined(figure.axes[0], axes)
        assert values.joined(figure.axes[0], axes)


def test_a_scan_without_errors_has_no_line_and_leaves_the_axis_as_it_is() -> None:
    usual = draw("truth_rd", metrics=metrics_table(3), scan_errors=scan_errors_table())
    exact = scan_errors_table().assign(truth_d2_rms_m=1e-10)
    figure = draw("truth_rd", metrics=metrics_table(3), scan_errors=exact)
    assert own_errors(figure.axes[1]) == []
    assert figure.axes[1].get_ylim() == usual.axes[1].get_ylim()


def test_figures_of_the_truth_fit_into_a_column_and_have_no_empty_panel() -> None:
    table = metrics_table(3)
    noisy = table[table["dataset"] == "s3dis_noisy"]
    both = pd.concat([noisy.assign(dataset="s3dis_clean"), noisy])
    clean = scan_errors_table().assign(dataset="s3dis_clean")
    errors = pd.concat([clean, scan_errors_table()])
    figure = draw("truth_rd", metrics=both, scan_errors=errors)
    assert len(figure.axes) == 4
    assert all(axes.axison and axes.get_lines() for axes in figure.axes)
    assert figure.get_size_inches()[0] == 3.5


@pytest.mark.parametrize(
    "name", ["truth_rd", "truth_rd_point", "truth_rd_hausdorff", "truth_accuracy"]
)
def test_the_sides_axes_end_a_marker_beyond_the_values(name: str) -> None:
    panels = draw(name, metrics=metrics_table(3), scan_errors=scan_errors_table()).axes
    points = np.concatenate([p for axes in panels for p in lines(axes).values() if len(p) != 2])
    for axis, limits in ((0, panels[0].get_xlim()), (1, panels[0].get_ylim())):
        beyond = points[:, axis].min() / limits[0], limits[1] / points[:, axis].max()
        assert all(1.2 < factor < 2 for factor in beyond)


def test_an_axis_range_of_the_style_is_kept_on_both_sides() -> None:
    style = FigureStyle(axis_ranges={"d2_mm": (1e-3, 1e5)})
    figure = draw("truth_rd", style, metrics=metrics_table(3), scan_errors=scan_errors_table())
    assert figure.axes[0].get_ylim() == (1e-3, 1e5)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 7])
def test_legends_are_read_row_by_row(count: int) -> None:
    names = [f"codec {n}" for n in range(count)]
    figure = Figure()
    add_rows_legend(figure, [Line2D([], [], label=name) for name in names], 3)
    figure.canvas.draw()
    drawn = figure.legends[0].get_texts()
    places = {t.get_text(): t.get_window_extent() for t in drawn}
    assert sorted(names, key=lambda n: (-round(places[n].y0), places[n].x0)) == names


def test_a_missing_rate_leaves_a_gap() -> None:
    table = metrics_table(2)
    is_left_out = (table["dataset"] == "capod") & (table["rate"] == "r3")
    colour = FigureStyle().of_datasets(table["dataset"])["capod"].colour
    drawn = lines(draw("medians_per_rate", metrics=table[~is_left_out]).axes[0])[colour]
    assert np.isfinite(drawn[:, 1]).tolist() == [True, True, False, True, True, True, True, True]


@pytest.mark.parametrize(("count", "first"), [(8, "r1"), (12, "1")])
def test_every_rate_is_named_as_there_is_room(count: int, first: str) -> None:
    panels = list(Figure().subplots(1, 4))
    label_rates(panels, [f"r{n}" for n in range(1, count + 1)], 4)
    names = [tick.get_text() for tick in panels[-1].get_xticklabels()]
    assert names[0] == first
    assert len(names) == count


def test_recovery_is_drawn_over_all_kinds_and_without_streams_of_points() -> None:
    panels = draw("recovery_rd", recovery=recovery_table()).axes
    colour = codec_style("primitives").colour
    for axes, shares in zip(
        panels, ([0.3, 0.5, 0.6], [0.2, 0.4, 0.5], [0.4, 0.6, 0.7]), strict=True
    ):
        np.testing.assert_allclose(lines(axes)[colour][:, 1], shares)
        assert axes.get_ylim() == (0, 1)


def test_clouds_of_different_elongation_are_not_joined() -> None:
    figure = draw("elongation", metrics=metrics_table(3), clouds=clouds_table(3))
    drawn = [line for axes in figure.axes for line in axes.get_lines()]
    assert drawn
    assert all(line.get_linestyle() == "None" for line in drawn)


def test_point_counts_show_quartiles_median_and_mean() -> None:
    counts = [100, 200, 200, 300, 400, 400, 9000]
    table = pd.DataFrame({"dataset": "rooms", "cloud": list("abcdefg"), "points": counts})
    axes = draw("point_counts", clouds=table).axes[0]
    drawn = [set(np.asarray(line.get_ydata()).tolist()) for line in axes.get_lines()]
    assert {300.0} in drawn  # median
    assert {sum(counts) / 7} in drawn  # mean
    assert {200.0, 400.0} in drawn  # quartiles
    assert axes.get_ylim()[1] > 9000  # few clouds: each is drawn
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["Rooms\n(n = 7)"]


def test_point_counts_have_no_quartiles_of_few_clouds() -> None:
    table = pd.DataFrame({"dataset": "rooms", "cloud": range(5), "points": [1, 2, 3, 4, 10]})
    figure = draw("point_counts", clouds=table)
    drawn = [set(line.get_ydata()) for line in figure.axes[0].get_lines() if len(line.get_ydata())]
    assert {2.0, 4.0} not in drawn
    assert {3.0} in drawn
    texts = {text.get_text() for text in figure.legends[0].get_texts()}
    assert texts == {"median", "mean", "cloud"}


@pytest.mark.parametrize(("clouds", "last"), [(12, "cloud"), (13, "mean")])
def test_point_counts_have_a_key_of_its_marks(clouds: int, last: str) -> None:
    table = pd.DataFrame({"dataset": "rooms", "cloud": range(clouds), "points": range(clouds)})
    figure = draw("point_counts", clouds=table)
    top = figure.axes[0].get_ylim()[1]
    assert 0.9 * top < table["points"].max() < 0.95 * top
    texts = figure.legends[0].get_texts()
    assert {"quartiles", "median", "mean", last} == {text.get_text() for text in texts}


def test_example_clouds_carry_a_scale_bar_in_metres() -> None:
    room = room_cloud(20_000)
    figure = draw("room_scans", example_raw=room, example_clean=room, example_noisy=room)
    *panels, bar = figure.axes
    assert [axes.get_title()[:3] for axes in panels] == ["(a)", "(b)", "(c)"]
    assert [axes.texts[0].get_text() for axes in panels] == ["1 m"] * 3
    assert bar.get_ylabel() == "Height (m)"
    assert 2.0 < bar.get_ylim()[1] < 2.7  # the ceiling of the 2.7 m high room is cut away


@pytest.mark.parametrize(("length", "expected"), [(0.9, 0.5), (1.0, 1.0), (4.9, 2.0), (70, 50)])
def test_scale_bars_have_round_lengths(length: float, expected: float) -> None:
    assert round_length(length) == pytest.approx(expected)


@pytest.mark.parametrize("name", [*FROM_METRICS, "point_counts"])
def test_a_table_without_rows_is_an_input_error(name: str) -> None:
    table = "clouds" if name == "point_counts" else "metrics"
    empty = (clouds_table(1) if table == "clouds" else metrics_table(1)).iloc[:0]
    with pytest.raises(InputError, match=f"^{table} table: no rows, nothing to draw$"):
        draw(name, **{table: empty})


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"cd_plane": np.nan}, "no value in column 'cd_plane'"),
        ({"cd_plane": -1.0}, "column 'cd_plane' has a negative or infinite value"),
        ({"cd_plane": "failed"}, "column 'cd_plane' has values that are not numbers"),
        ({"bpp": 0.0}, "column 'bpp' has a value of zero"),
    ],
)
def test_values_that_cannot_be_drawn_are_named(change: dict[str, Any], fault: str) -> None:
    with pytest.raises(InputError, match=f"metrics table: {fault}"):
        draw("chamfer_rd", metrics=metrics_table(1).assign(**change))


def test_a_missing_column_is_named() -> None:
    with pytest.raises(InputError, match="metrics table: no column 'encode_s'"):
        draw("encoding_time", metrics=metrics_table(1).drop(columns="encode_s"))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (None, "no such file"),
        ("dataset,bpp\n", "the table has no rows"),
        ("", "not a readable table"),
        ('a,b\n"1,2\n', "not a readable table"),
    ],
)
def test_an_unusable_table_file_is_named(tmp_path: Path, text: str | None, fault: str) -> None:
    path = tmp_path / "metrics.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=f"metrics.csv: {fault}"):
        read_table(path)


def test_names_that_look_like_numbers_stay_text(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    path.write_text("dataset,cloud,codec,rate,bpp\n007,01,1,1,0.5\n")
    assert read_table(path).iloc[0, :4].tolist() == ["007", "01", "1", "1"]


def test_a_failed_drawing_leaves_no_file(input_files: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a figure is written as \.pdf, \.png, \.svg"):
        draw_files(
            "chamfer_rd", input_files, [tmp_path / "a.pdf", tmp_path / "a.gif"], FigureStyle()
        )
    with pytest.raises(InputError, match="figure point_counts: needs the input 'clouds'"):
        draw_files("point_counts", {}, [tmp_path / "a.pdf"], FigureStyle())
    assert list(tmp_path.iterdir()) == []


def test_the_spread_shows_quartiles_and_nine_clouds_in_ten() -> None:
    values = np.arange(1.0, 102.0)
    names = {"dataset": "rooms", "cloud": range(len(values)), "codec": "draco", "rate": "r1"}
    table = pd.DataFrame({**names, "cd_plane": values})
    axes = draw("spread", metrics=table).axes[0]
    (box,) = axes.patches
    assert isinstance(box, PathPatch)
    assert set(box.get_path().vertices[:4, 1]) == {26.0, 76.0}
    ends = {float(y) for line in axes.get_lines() for y in line.get_ydata()}
    assert {6.0, 51.0, 96.0} <= ends


def test_of_few_clouds_the_spread_shows_each() -> None:
    values = [1.0, 2.0, 6.0, 8.0, 20.0]
    names = {"dataset": "rooms", "cloud": range(len(values)), "codec": "draco", "rate": "r1"}
    table = pd.DataFrame({**names, "cd_plane": values})
    axes = draw("spread", metrics=table).axes[0]
    assert not axes.patches
    medians, clouds = axes.get_lines()
    assert medians.get_ydata().tolist() == [6.0]
    assert clouds.get_ydata().tolist() == values
    assert clouds.get_linestyle() == "None"
