"""Labels of axes, with the direction in which values are better."""

from __future__ import annotations

from puckbench.results.columns import HIGHER, LOWER, Column, column_named

BETTER = "\N{LEFTWARDS ARROW} better"
"""Label of axes on which lower values are better; on a vertical axis, the arrow points down."""
HIGHER_BETTER = "better \N{RIGHTWARDS ARROW}"
_DIRECTIONS = {LOWER: f", {BETTER}", HIGHER: f", {HIGHER_BETTER}", None: ""}

BPP, CD_PLANE, CD_POINT = column_named("bpp"), column_named("cd_plane"), column_named("cd_point")
HD_PLANE = column_named("hausdorff_sq_plane")
ENCODE_TIME, DECODE_TIME = column_named("encode_s"), column_named("decode_s")


def axis_label(shown: Column, lines: int = 1) -> str:
    """Return the label of an axis that shows a column of results.

    Parameters
    ----------
    shown
        The column.
    lines
        Number of lines: with two, the unit begins the second.
    """
    unit = f"{' ' if lines == 1 else chr(10)}({shown.unit})" if shown.unit else ""
    return f"{shown.short or shown.words}{unit}{_DIRECTIONS[shown.better]}"
