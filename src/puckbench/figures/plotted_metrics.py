"""The quantities that are drawn: table column, words, unit, and the thesis's axis range."""

from __future__ import annotations

from dataclasses import dataclass, replace

from puckbench.figures.style import Range


@dataclass(frozen=True)
class Quantity:
    """A column of the results table, and how an axis shows it.

    Parameters
    ----------
    column
        Of the table.
    words, unit
        Of the axis label. The grid unit is that of the scaled cloud: 1/1023 of its longest side.
    limits
        Range of the axis in the thesis.
    """

    column: str
    words: str
    unit: str
    limits: Range

    @property
    def label(self) -> str:
        """Axis label on one line."""
        return f"{self.words} ({self.unit})"

    @property
    def short_label(self) -> str:
        """Axis label on two lines, for small panels."""
        return f"{self.words}\n({self.unit})"

    def within(self, low: float, high: float) -> Quantity:
        """The same quantity with another default range."""
        return replace(self, limits=(low, high))


BPP = Quantity("bpp", "Bits per point", "bpp", (0.01, 100))
CD_PLANE = Quantity("cd_plane", "CD, point-to-plane", "grid units²", (0.01, 1000))
CD_POINT = Quantity("cd_point", "CD, point-to-point", "grid units²", (0.01, 1000))
HD_PLANE = Quantity("hausdorff_sq_plane", "HD², point-to-plane", "grid units²", (0.1, 1e4))
ENCODE_TIME = Quantity("encode_s", "Encoding time", "s", (0.1, 100))
DECODE_TIME = Quantity("decode_s", "Decoding time", "s", (0.1, 100))
