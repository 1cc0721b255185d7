from __future__ import annotations

from dataclasses import dataclass

BETTER = "\N{LEFTWARDS ARROW} better"
"""Label of axes on which lower values are better; on a vertical axis, the arrow points down."""
HIGHER_BETTER = "better \N{RIGHTWARDS ARROW}"


@dataclass(frozen=True)
class PlottedMetric:
    """A column of the results that figures draw, with the texts of its axis.

    Lower values of these columns are better, as the labels say. The grid unit of a scaled cloud is
    1/1023 of the cloud's longest side.

    Parameters
    ----------
    column
        Name of the column.
    words
        Name of the metric in labels.
    unit
        Unit of the values in labels.
    """

    column: str
    words: str
    unit: str

    @property
    def is_time(self) -> bool:
        """Whether the column contains times."""
        return self.unit == "s"

    @property
    def label(self) -> str:
        """Label of an axis in one line."""
        return f"{self.words} ({self.unit}), {BETTER}"

    @property
    def short_label(self) -> str:
        """Label of an axis in two lines."""
        return f"{self.words}\n({self.unit}), {BETTER}"


BPP = PlottedMetric("bpp", "Bits per point", "bpp")
CD_PLANE = PlottedMetric("cd_plane", "CD, point-to-plane", "grid units²")
CD_POINT = PlottedMetric("cd_point", "CD, point-to-point", "grid units²")
HD_PLANE = PlottedMetric("hausdorff_sq_plane", "HD², point-to-plane", "grid units²")
ENCODE_TIME = PlottedMetric("encode_s", "Encoding time", "s")
DECODE_TIME = PlottedMetric("decode_s", "Decoding time", "s")
