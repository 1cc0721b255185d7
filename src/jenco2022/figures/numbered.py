"""Figures 6.1 to 6.9 of the thesis: figures of puckbench under the numbers of the thesis.

Runs that are not compared with the thesis draw them under their own names.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from puckbench.figures import example_clouds, per_bpp, per_rate, point_counts
from puckbench.figures.registry import FIGURES, figure_entry

CODE = ("puckbench.figures.*", "puckbench.geometry.rendering")


def _register(number: str, name: str, draw: Callable[..., Any], remark: str = "") -> None:
    entry = figure_entry(name)
    register = FIGURES.register(
        f"fig_{number.replace('.', '_')}",
        title=entry.title,
        category=entry.category,
        number=number,
        instead_of=name,
        needs=("thesis",),
        remark=f"Thesis figure {number}. {remark}",
        is_first_look=entry.is_first_look,
    )
    register(draw)


_TIMES = "In the thesis, times include the start of a process."

_register("6.1", "sampled_object", example_clouds.draw_object)
_register("6.2", "raw_room", example_clouds.draw_raw_room)
_register("6.3", "room_scans", example_clouds.draw_room_versions)
_register("6.4", "point_counts", point_counts.draw_point_counts)
_register(
    "6.5",
    "medians_per_rate",
    per_rate.draw_medians_per_rate,
    f"The thesis draws all codecs over one axis of rates. {_TIMES}",
)
_register(
    "6.6",
    "chamfer_rd",
    per_bpp.draw_chamfer,
    "In the thesis, Draco also coded other attributes of scans.",
)
_register(
    "6.7",
    "hausdorff_rd",
    per_bpp.draw_hausdorff,
    'The thesis omits "squared", but the tool reports squared distances.',
)
_register("6.8", "encoding_time", per_bpp.draw_encoding_time, _TIMES)
_register("6.9", "decoding_time", per_bpp.draw_decoding_time, _TIMES)
