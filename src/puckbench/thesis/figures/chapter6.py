"""The figures of thesis chapter 6: clouds and what compression does to them, and our own."""

from __future__ import annotations

from puckbench.figures.entry import FigureEntry

_CLOUDS, _RATES, _CURVES = "Clouds", "Results per rate", "Rate-distortion"

FIGURES: dict[str, FigureEntry] = {
    "fig_6_1": FigureEntry(
        "puckbench.thesis.figures.example_clouds:draw_object",
        ("example_object",),
        "Example cloud of the object set",
        _CLOUDS,
        "6.1",
    ),
    "fig_6_2": FigureEntry(
        "puckbench.thesis.figures.example_clouds:draw_raw_room",
        ("example_raw",),
        "Example cloud of a raw room",
        _CLOUDS,
        "6.2",
    ),
    "fig_6_3": FigureEntry(
        "puckbench.thesis.figures.example_clouds:draw_room_versions",
        ("example_raw", "example_clean", "example_noisy"),
        "One room: raw, scanned without noise, scanned with noise",
        _CLOUDS,
        "6.3",
    ),
    "fig_6_4": FigureEntry(
        "puckbench.thesis.figures.point_counts:draw_point_counts",
        ("clouds",),
        "Point counts per data set",
        _CLOUDS,
        "6.4",
    ),
    "fig_6_5": FigureEntry(
        "puckbench.thesis.figures.per_rate:draw_medians_per_rate",
        ("metrics",),
        "Medians per compression rate",
        _RATES,
        "6.5",
    ),
    "fig_6_6": FigureEntry(
        "puckbench.thesis.figures.per_bpp:draw_chamfer",
        ("metrics",),
        "Chamfer distance (point-to-plane) against bits per point",
        _CURVES,
        "6.6",
    ),
    "fig_6_7": FigureEntry(
        "puckbench.thesis.figures.per_bpp:draw_hausdorff",
        ("metrics",),
        "Hausdorff distance (point-to-plane, squared) against bits per point",
        _CURVES,
        "6.7",
    ),
    "fig_6_8": FigureEntry(
        "puckbench.thesis.figures.per_bpp:draw_encoding_time",
        ("metrics",),
        "Encoding time against bits per point",
        _CURVES,
        "6.8",
    ),
    "fig_6_9": FigureEntry(
        "puckbench.thesis.figures.per_bpp:draw_decoding_time",
        ("metrics",),
        "Decoding time against bits per point",
        _CURVES,
        "6.9",
    ),
    "spread": FigureEntry(
        "puckbench.figures.spread:draw_spread",
        ("metrics",),
        "Spread of the Chamfer distance over clouds, per codec and rate",
        _RATES,
    ),
    "truth_rd": FigureEntry(
        "puckbench.figures.truth_rd:draw_chamfer",
        ("metrics", "scan_errors"),
        "Distortion to the scan and to the truth (point-to-plane) against bits per point",
        _CURVES,
    ),
    "truth_rd_point": FigureEntry(
        "puckbench.figures.truth_rd:draw_chamfer_point",
        ("metrics", "scan_errors"),
        "Distortion to the scan and to the truth (point-to-point) against bits per point",
        _CURVES,
    ),
    "truth_rd_hausdorff": FigureEntry(
        "puckbench.figures.truth_rd:draw_hausdorff",
        ("metrics", "scan_errors"),
        "Hausdorff distance to the scan and to the truth (point-to-plane, squared)",
        _CURVES,
    ),
    "recovery_rd": FigureEntry(
        "puckbench.figures.recovery_rd:draw_recovery",
        ("recovery",),
        "Recovery of the scenes' geometric primitives against bits per point",
        _CURVES,
    ),
}
