from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jenco2022.published import PRINTED_STD_M
from pointkit.yaml_files import read_yaml
from puckbench.figures.panels import add_rows_legend
from puckbench.figures.plot_styles import dataset_title, error_model_colour
from puckbench.figures.style import FigureStyle
from virtual_lidar.errors import ModelStyle, error_model_style
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")


def _read_styles() -> dict[str, ModelStyle]:
    entries = read_yaml(Path(__file__).with_suffix(".yaml"))
    return {
        name: ModelStyle(**entry) if entry else error_model_style(name)
        for name, entry in entries.items()
    }


MODEL_STYLES: dict[str, ModelStyle] = _read_styles()
"""Styles of error models, and of the real sensor, in the order of legends."""


def model_style(model: str, style: FigureStyle) -> ModelStyle:
    """Return how to draw an error model, with the changes that `style` makes to colours."""
    plot_style = MODEL_STYLES.get(model) or error_model_style(model)
    if not (plot_style.title and plot_style.colour):
        plot_style = ModelStyle(dataset_title(model), error_model_colour(model))
    return ModelStyle(plot_style.title, style.colours.get(model, plot_style.colour))


def ordered_models(models: Iterable[str]) -> list[str]:
    """Return the names of models without repetitions, in the order of thesis Figure 5.18."""
    names = list(MODEL_STYLES)
    rank = {name: place for place, name in enumerate(names)}
    return sorted(set(models), key=lambda model: (rank.get(model, len(names)), model))


def add_model_legend(figure: Figure, models: Sequence[str], style: FigureStyle) -> None:
    """Add a legend with an entry for each model.

    Without captures among the models, a further entry explains the dashed line of the thesis's real
    standard deviation.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = [
        Patch(color=model_style(model, style).colour, alpha=0.5, label=source_title(model, style))
        for model in models
    ]
    if REAL not in models:
        real = model_style(REAL, style).colour
        text = f"Not captured; thesis: std \u00b1{PRINTED_STD_M:g} m"
        handles.append(Line2D([], [], color=real, linestyle="--", linewidth=0.8, label=text))
    letters = sum(len(str(handle.get_label())) for handle in handles)
    in_a_row_in = letters * 0.58 * style.font_size / 72 + 0.5 * len(handles)
    add_rows_legend(
        figure, handles, len(handles) if in_a_row_in < figure.get_size_inches()[0] else 1
    )


def counted(title: str, returns: int) -> str:
    """Return a title followed by the number of returns."""
    return f"{title} (n = {returns:,})"


def source_title(model: str, style: FigureStyle) -> str:
    """Return the title of the real sensor, or "Virtual (...)" with the title of an error model."""
    title = model_style(model, style).title
    return title if model == REAL else f"Virtual ({title})"
