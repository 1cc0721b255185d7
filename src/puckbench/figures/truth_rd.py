from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.curves import (
    binned_curves,
    check_curve_columns,
    codecs_of,
    draw_curves,
    lossless_handles,
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
from puckbench.figures.plotted_metrics import BPP, CD_PLANE, CD_POINT, HD_PLANE, PlottedMetric
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_PREFIXES = {"": "to the scan", "truth_": "to the truth"}
_ACCURACY = PlottedMetric(
    "truth_acd_ba_plane", "Distance, point-to-plane", "grid units²", (0.01, 1000)
)
_DIRECTIONS = {
    "accuracy": _ACCURACY,
    "completeness": replace(_ACCURACY, column="truth_acd_ab_plane"),
}


@FIGURES.register(
    "truth_rd",
    title="Distortion to the scan and to the truth (point-to-plane) against bits per point",
    category="Rate-distortion",
)
def draw_truth_chamfer(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """Chamfer distance (point to plane, squared grid units) against bits per point: to the original
    scan, and to the true surface. Markers: medians in ten bins of equally many results or, with few
    clouds, at each rate. Bars: quartiles. n: clouds. All panels have equal axes.

    Dashed: median distance of the scan before coding, if inside the axes. The curve of a codec that
    reproduces the scan's noise approaches this line. Below the line, decoded points are nearer to
    the surface than the scan is. Not in the thesis.
    """
    return draw_references(metrics, scan_errors, CD_PLANE, style)


@FIGURES.register(
    "truth_rd_point",
    title="Distortion to the scan and to the truth (point-to-point) against bits per point",
    category="Rate-distortion",
)
def draw_truth_chamfer_point(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """Chamfer distance (point to point, squared grid units) against bits per point, otherwise as in
    figure ``truth_rd``.
    """
    return draw_references(metrics, scan_errors, CD_POINT, style)


@FIGURES.register(
    "truth_rd_hausdorff",
    title="Hausdorff distance to the scan and to the truth (point-to-plane, squared)",
    category="Rate-distortion",
)
def draw_truth_hausdorff(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """Squared Hausdorff distance (point to plane, squared grid units) against bits per point,
    otherwise as in figure ``truth_rd``.
    """
    return draw_references(metrics, scan_errors, HD_PLANE, style)


@FIGURES.register(
    "truth_accuracy",
    title="Accuracy and completeness (point-to-plane) against bits per point",
    category="Rate-distortion",
)
def draw_truth_accuracy(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """Mean squared distances (point to plane, squared grid units) against bits per point: from
    decoded points to the true surface (accuracy), and from true points to the decoded cloud
    (completeness). Otherwise as in figure ``truth_rd``.
    """
    return _draw_distances(metrics, scan_errors, _DIRECTIONS, style)


def draw_references(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, metric: PlottedMetric, style: FigureStyle
) -> Figure:
    """Draw two panels for each data set: distances to the original scan, and to the true surface.

    `metric` is the distance to the scan; columns ``truth_...`` have distances to the surface.
    """
    references = {
        title: replace(metric, column=f"{prefix}{metric.column}")
        for prefix, title in _PREFIXES.items()
    }
    return _draw_distances(metrics, scan_errors, references, style)


def _draw_distances(
    metrics: pd.DataFrame,
    scan_errors: pd.DataFrame,
    distances: dict[str, PlottedMetric],
    style: FigureStyle,
) -> Figure:
    references, titles = list(distances.values()), list(distances)
    metric = references[0]
    for reference in references:
        check_curve_columns(metrics, reference)
    of_truth = [name for name in references if name.column.startswith("truth_")]
    rows = metrics.dropna(subset=[reference.column for reference in of_truth])
    curves = [binned_curves(rows, reference, style) for reference in references]
    panel_lines = [lines for dataset_curves in curves for lines in dataset_curves.values()]
    limits = [
        shared_limits(panel_lines, axis_metric, style, fitted=True) for axis_metric in (BPP, metric)
    ]
    scan_medians = _scan_medians(scan_errors, of_truth)
    abreast = len(references)
    figure, panels = panel_grid(len(panel_lines), abreast, 1.9, style, width_in=COLUMN_WIDTH_IN)
    for index, axes in enumerate(panels):
        dataset, column = list(curves[0])[index // abreast], index % abreast
        draw_curves(axes, curves[column][dataset], limits[0], limits[1], style)
        scan = scan_medians.get((dataset, references[column].column), 0.0)
        if scan >= limits[1][0]:
            axes.axhline(scan, zorder=2, **SCAN_LINE)
        title = f"{style.title(dataset)}: {titles[column]}"
        set_title(axes, titled(title, rows[rows["dataset"] == dataset]), abreast, style)
    label_outer(panels, abreast, "", metric.short_label)
    figure.supxlabel(BPP.label, fontsize=style.font_size)
    extra_handles = [scan_handle(), *lossless_handles(panel_lines)]
    add_legend(figure, codecs_of(panel_lines, style), style, extra_handles)
    return figure


def _scan_medians(
    scan_errors: pd.DataFrame, references: list[PlottedMetric]
) -> dict[tuple[str, str], float]:
    columns = tuple(reference.column for reference in references)
    require_rows(scan_errors, ("dataset", *columns), "scan errors")
    require_numbers(scan_errors, columns, "scan errors")
    medians = scan_errors.groupby("dataset")[list(columns)].median()
    return {
        (str(dataset), column): float(row[column])
        for dataset, row in medians.iterrows()
        for column in columns
    }
