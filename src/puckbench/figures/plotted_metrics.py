from __future__ import annotations

from dataclasses import dataclass, replace

from puckbench.figures.style import Range

BETTER = "\N{LEFTWARDS ARROW} better"
"""Label of axes on which lower values are better; on a vertical axis, the arrow points down."""
HIGHER_BETTER = "better \N{RIGHTWARDS ARROW}"


@dataclass(frozen=True)
class PlottedMetric:
    """A column of the results, with axis range; its labels say that lower values are better.

    The grid unit of a scaled cloud is 1/1023 of its longest side.
    """

    column: str
    words: str
    unit: str
    limits: Range

    @property
    def is_time(self) -> bool:
        return self.unit == "s"

    @property
    def label(self) -> str:
        return f"{self.words} ({self.unit}), {BETTER}"

    @property
    def short_label(self) -> str:
        return f"{self.words}\n({self.unit}), {BETTER}"

    def within(self, low: float, high: float) -> PlottedMetric:
        return replace(self, limits=(low, high))


BPP = PlottedMetric("bpp", "Bits per point", "bpp", (0.01, 100))
CD_PLANE = PlottedMetric("cd_plane", "CD, point-to-plane", "grid units²", (0.01, 1000))
CD_POINT = PlottedMetric("cd_point", "CD, point-to-point", "grid units²", (0.01, 1000))
HD_PLANE = PlottedMetric("hausdorff_sq_plane", "HD², point-to-plane", "grid units²", (0.1, 1e4))
ENCODE_TIME = PlottedMetric("encode_s", "Encoding time", "s", (0.1, 100))
DECODE_TIME = PlottedMetric("decode_s", "Decoding time", "s", (0.1, 100))
