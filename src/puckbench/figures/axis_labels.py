"""Labels of axes, with the direction in which values are better."""

from __future__ import annotations

from puckbench.results.columns import HIGHER, LOWER, Column, column_named

BETTER = "\N{LEFTWARDS ARROW} better"
"""Label of axes on which lower values are better; on a vertical axis, the arrow points down."""
HIGHER_BETTER = "better \N{RIGHTWARDS ARROW}"
_DIRECTIONS = {LOWER: f", {BETTER}", HIGHER: f", {HIGHER_BETTER}", None: ""}

BPP, ENCODE_TIME, DECODE_TIME = map(column_named, ("bpp", "encode_s", "decode_s"))
CD_PLANE, CD_POINT = map(column_named, ("cd_plane", "cd_point"))
HD_PLANE = column_named("hausdorff_sq_plane")


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
    return f"{shown.short_words}{unit}{_DIRECTIONS[shown.better]}"
