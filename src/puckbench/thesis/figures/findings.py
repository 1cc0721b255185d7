"""Figures that the thesis lacks: its medians beside ours, and what moves G-PCC's curve."""

from __future__ import annotations

from puckbench.figures.entry import BOTH_GPCC, FigureEntry

_FINDINGS = "Findings"

FIGURES: dict[str, FigureEntry] = {
    "beside_thesis": FigureEntry(
        "puckbench.thesis.figures.beside_thesis:draw_beside_thesis",
        ("thesis_medians",),
        "The thesis's medians per compression rate beside ours",
        _FINDINGS,
    ),
    "gpcc_grid": FigureEntry(
        "puckbench.thesis.figures.gpcc_grid:draw_scales",
        ("gpcc_scales",),
        "G-PCC's bits and distortion against the scale of its grid",
        _FINDINGS,
    ),
    "gpcc_rounding": FigureEntry(
        "puckbench.thesis.figures.gpcc_grid:draw_rounding",
        ("gpcc_scales",),
        "What truncated coordinates cost G-PCC in distortion",
        _FINDINGS,
        needs=(BOTH_GPCC,),
    ),
    "gpcc_contexts": FigureEntry(
        "puckbench.thesis.figures.gpcc_grid:draw_contexts",
        ("gpcc_scales",),
        "What neighbour contexts save G-PCC in bits",
        _FINDINGS,
        needs=(BOTH_GPCC,),
    ),
    "elongation": FigureEntry(
        "puckbench.thesis.figures.elongation:draw_elongation",
        ("metrics", "clouds"),
        "Chamfer distance against the elongation of the cloud",
        _FINDINGS,
    ),
}
