"""How each error model is shown: one title and one colour wherever it appears."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

from puckbench.figures.style import FigureStyle
from puckbench.lidar.errors import ERROR_MODELS
from puckbench.lidar.residual_table import REAL


@dataclass(frozen=True)
class ModelLook:
    """An error model's title (legends, ticks, panels) and colour (hex)."""

    title: str
    colour: str


# What stands in tables beside the registered error models, which have their own title and colour.
# The palette of Okabe and Ito for what the thesis compares, darker hues of Tol's for the others.
_BESIDE = {
    REAL: ModelLook("Real VLP-16", "#D55E00"),
    "vlp16_fig518": ModelLook("VLP-16, as\u00a05.18", "#88CCEE"),
    "vlp16_divergence_fig518": ModelLook("Divergence, as\u00a05.18", "#44AA99"),
}
# The order is that of the thesis (Figure 5.18), then what goes past it.
_ORDER = (
    *(REAL, "none", "hdl64e", "vlp16", "vlp16_divergence", "vlp16_incidence", "vlp16_measured"),
    *("calibrated", "surface_normal", "beam_footprint", "distance_table", "vlp16_table51"),
    *("vlp16_fig518", "vlp16_divergence_fig518", "thesis_room"),
)


def _look(name: str) -> ModelLook:
    if name in _BESIDE:
        return _BESIDE[name]
    model = ERROR_MODELS.get(name)
    return ModelLook(model.title, model.colour)


MODEL_LOOKS = {name: _look(name) for name in _ORDER}

_OTHER_COLOURS = ("#44AA99", "#AA4499", "#8C6000", "#BB5566", "#5D4037", "#66CDAA")


def model_look(model: str, style: FigureStyle) -> ModelLook:
    """The look of an error model; one that has none gets a colour from its name alone.

    The style's `colours` may name error models too.
    """
    known = MODEL_LOOKS.get(model)
    if known is None and model in ERROR_MODELS:
        known = _look(model)
    if known is None or not (known.title and known.colour):
        digest = hashlib.sha256(model.encode()).digest()
        words = model.replace("_", " ")
        title = words[:1].upper() + words[1:]
        known = ModelLook(title, _OTHER_COLOURS[digest[0] % len(_OTHER_COLOURS)])
    return ModelLook(known.title, style.colours.get(model, known.colour))


def ordered_models(models: Iterable[str]) -> list[str]:
    """Each model once: the table's order, then by name."""
    names = list(MODEL_LOOKS)
    rank = {name: place for place, name in enumerate(names)}
    return sorted(set(models), key=lambda model: (rank.get(model, len(names)), model))
