from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from puckbench.figures.axis_labels import BPP, axis_label
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.curves import (
    binned_curves,
    check_curve_columns,
    codecs_of,
    draw_curves,
    mark_handles,
    shared_limits,
)
from puckbench.figures.panels import (
    SCAN_LINE,
    add_legend,
    label_outer,
    panel_grid,
    scan_handle,
    set_title,
    titled,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, FigureStyle
from puckbench.results.columns import LOWER, Column

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_PREFIXES = {"": "to the scan", "truth_": "to the truth"}
_D1 = Column("d1_mm", "RMS distance (D1)", "mm", LOWER)
_D2 = Column("d2_mm", "RMS distance (D2)", "mm", LOWER)
_FARTHEST = Column("farthest_mm", "Largest distance", "mm", LOWER)
_ACCURACY = Column("truth_accuracy_mm", "RMS distance", "mm", LOWER)
_COMPLETENESS = replace(_ACCURACY, name="truth_completeness_mm")
_SOURCES = {
    "d1_mm": "d1_rms_m",
    "d2_mm": "d2_rms_m",
    "farthest_mm": "hausdorff_plane_m",
    "accuracy_mm": "acd_ba_plane",
    "completeness_mm": "acd_ab_plane",
}
"""Columns of the results, in m or in squared grid units, from which columns in mm are computed."""


@FIGURES.register(
    "truth_rd",
    title="Distance to the scan and to the truth (point-to-plane) against bits per point",
    category="Rate-distortion",
)
def draw_truth_chamfer(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """RMS distance (D2: point to plane, the larger of both directions) in millimetres, against bits
    per point: to the original scan, and to the true surface. Markers are medians of ten bins
    with equally many results or, with few clouds, of each rate. Bars are quartiles; with fewer
    than six clouds, there is a dot for each cloud instead. n is the number of clouds. All panels
    have equal axes.

    The dashed line is the median distance of the scan before coding, if it is inside the axes. The
    curve of a codec that reproduces the scan's noise approaches this line. Below the line, decoded
    points are nearer to the surface than the scan is.
    """
    return _draw_references(metrics, scan_errors, _D2, style)


@FIGURES.register(
    "truth_rd_point",
    title="Distance to the scan and to the truth (point-to-point) against bits per point",
    category="Rate-distortion",
)
def draw_truth_chamfer_point(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """RMS distance (D1: point to point, the larger of both directions) in millimetres, against bits
    per point. Panels, lines and markers are as in figure ``truth_rd``.
    """
    return _draw_references(metrics, scan_errors, _D1, style)


@FIGURES.register(
    "truth_rd_hausdorff",
    title="Hausdorff distance to the scan and to the truth (point-to-plane)",
    category="Rate-distortion",
)
def draw_truth_hausdorff(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """Largest distance (Hausdorff distance, point to plane) in millimetres, against bits per point.
    Panels, lines and markers are as in figure ``truth_rd``.
    """
    return _draw_references(metrics, scan_errors, _FARTHEST, style)


@FIGURES.register(
    "truth_accuracy",
    title="Accuracy and completeness (point-to-plane) against bits per point",
    category="Rate-distortion",
)
def draw_truth_accuracy(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """RMS distances (point to plane) in millimetres, against bits per point: from decoded points to
    the true surface (accuracy), and from true points to the decoded cloud (completeness). Lines
    and markers are as in figure ``truth_rd``.
    """
    directions = {"accuracy": _ACCURACY, "completeness": _COMPLETENESS}
    return _draw_distances(metrics, scan_errors, directions, style)


def _draw_references(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, metric: Column, style: FigureStyle
) -> Figure:
    references = {
        title: replace(metric, name=f"{prefix}{metric.name}") for prefix, title in _PREFIXES.items()
    }
    return _draw_distances(metrics, scan_errors, references, style)


def _draw_distances(
    metrics: pd.DataFrame,
    scan_errors: pd.DataFrame,
    distances: dict[str, Column],
    style: FigureStyle,
) -> Figure:
    references, titles = list(distances.values()), list(distances)
    metric = references[0]
    of_truth = [each for each in references if each.name.startswith("truth_")]
    metrics = _in_millimetres(metrics, [each.name for each in references], "metrics")
    scan_errors = _in_millimetres(scan_errors, [each.name for each in of_truth], "scan errors")
    for reference in references:
        check_curve_columns(metrics, reference)
    rows = metrics.dropna(subset=[reference.name for reference in of_truth])
    curves = [binned_curves(rows, reference, style) for reference in references]
    panel_lines = [lines for dataset_curves in curves for lines in dataset_curves.values()]
    limits = [shared_limits(panel_lines, of_axis, style) for of_axis in (BPP, metric)]
    scan_medians = _scan_medians(scan_errors, of_truth)
    abreast = len(references)
    figure, panels = panel_grid(len(panel_lines), abreast, 1.9, style, width_in=COLUMN_WIDTH_IN)
    for index, axes in enumerate(panels):
        dataset, column = list(curves[0])[index // abreast], index % abreast
        draw_curves(axes, curves[column][dataset], limits[0], limits[1], style)
        scan = scan_medians.get((dataset, references[column].name), 0.0)
        if scan >= limits[1][0]:
            axes.axhline(scan, zorder=2, **SCAN_LINE)
        title = f"{style.title(dataset)}: {titles[column]}"
        set_title(axes, titled(title, rows[rows["dataset"] == dataset]), abreast, style)
    label_outer(panels, abreast, "", axis_label(metric, 2))
    figure.supxlabel(axis_label(BPP), fontsize=style.font_size)
    extra_handles = [scan_handle(), *mark_handles(panel_lines)]
    add_legend(figure, codecs_of(panel_lines, style), style, extra_handles)
    return figure


def _in_millimetres(table: pd.DataFrame, columns: Iterable[str], what: str) -> pd.DataFrame:
    converted: dict[str, Any] = {}
    for column in columns:
        prefix = "truth_" if column.startswith("truth_") else ""
        source = prefix + _SOURCES[column.removeprefix(prefix)]
        in_metres = source.endswith("_m")
        needed = (source,) if in_metres else (source, "scale")
        require_rows(table, ("dataset", *needed), what)
        require_numbers(table, needed, what)
        distances = table[source] if in_metres else table[source] ** 0.5 / table["scale"]
        converted[column] = 1000 * distances
    return table.assign(**converted)


def _scan_medians(
    scan_errors: pd.DataFrame, references: list[Column]
) -> dict[tuple[str, str], float]:
    columns = [reference.name for reference in references]
    medians = scan_errors.groupby("dataset")[columns].median()
    return {
        (str(dataset), column): float(row[column])
        for dataset, row in medians.iterrows()
        for column in columns
    }
