"""The legend of chapter 5's figures: which data are real, which virtual, which only published."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from puckbench.figures.style import FigureStyle
from puckbench.lidar.residual_table import REAL
from puckbench.thesis.figures.model_styles import model_look
from puckbench.thesis.published import PRINTED_STD_M

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure


def add_model_legend(figure: Figure, models: Sequence[str], style: FigureStyle) -> None:
    """One entry per model above the panel; without a capture one that says so."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = [
        Patch(color=model_look(model, style).colour, alpha=0.5, label=source_title(model, style))
        for model in models
    ]
    if REAL not in models:
        real = model_look(REAL, style).colour
        text = f"Not captured; thesis: std \u00b1{PRINTED_STD_M:g} m"
        handles.append(Line2D([], [], color=real, linestyle="--", linewidth=0.8, label=text))
    letters = sum(len(str(handle.get_label())) for handle in handles)
    in_a_row_in = letters * 0.58 * style.font_size / 72 + 0.5 * len(handles)
    abreast = len(handles) if in_a_row_in < figure.get_size_inches()[0] else 1
    figure.legend(handles=handles, loc="outside upper center", ncols=abreast)


def source_title(model: str, style: FigureStyle) -> str:
    """Title that says whether the data are captured or simulated."""
    title = model_look(model, style).title
    return title if model == REAL else f"Virtual ({title})"
