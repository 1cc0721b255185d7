from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jenco2022.published import PRINTED_STD_M
from puckbench.figures.panels import add_rows_legend
from puckbench.figures.plot_styles import dataset_title, error_model_colour
from puckbench.figures.style import FigureStyle
from virtual_lidar.errors import ERROR_MODELS
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")


@dataclass(frozen=True)
class ModelStyle:
    """How figures draw an error model or the real sensor: title and colour."""

    title: str
    colour: str


_UNREGISTERED = {
    REAL: ModelStyle("Real VLP-16", "#CC0055"),
    "vlp16_fig518": ModelStyle("VLP-16, as\u00a05.18", "#CCBBAA"),
    "vlp16_divergence_fig518": ModelStyle("Divergence, as\u00a05.18", "#AA9977"),
}
# The models of thesis Figure 5.18 come first, in its order.
_ORDER = (
    *(REAL, "none", "hdl64e", "vlp16", "vlp16_divergence", "vlp16_incidence", "vlp16_measured"),
    *("calibrated", "surface_normal", "beam_footprint", "distance_table", "vlp16_table51"),
    *("vlp16_fig518", "vlp16_divergence_fig518", "thesis_room"),
)


def _registered(name: str) -> ModelStyle:
    if name in _UNREGISTERED:
        return _UNREGISTERED[name]
    model = ERROR_MODELS.get(name)
    return ModelStyle(model.title, model.colour)


MODEL_STYLES = {name: _registered(name) for name in _ORDER}


def model_style(model: str, style: FigureStyle) -> ModelStyle:
    """Return how to draw an error model, with the changes that `style` makes to colours."""
    plot_style = MODEL_STYLES.get(model)
    if plot_style is None and model in ERROR_MODELS:
        plot_style = _registered(model)
    if plot_style is None or not (plot_style.title and plot_style.colour):
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
