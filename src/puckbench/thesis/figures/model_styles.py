"""How each error model is shown: one title and one colour wherever it appears."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

from puckbench.figures.style import FigureStyle
from puckbench.lidar.residual_table import REAL


@dataclass(frozen=True)
class ModelLook:
    """An error model's title (legends, ticks, panels) and colour (hex)."""

    title: str
    colour: str


# The palette of Okabe and Ito for what the thesis compares, darker hues of Tol's for the others.
# The order is that of the thesis (Figure 5.18), then what goes past it.
MODEL_LOOKS: dict[str, ModelLook] = {
    REAL: ModelLook("Real VLP-16", "#D55E00"),
    "none": ModelLook("No noise", "#777777"),
    "hdl64e": ModelLook("HDL-64E", "#CC79A7"),
    "vlp16": ModelLook("VLP-16", "#0072B2"),
    "vlp16_divergence": ModelLook("Beam divergence", "#009E73"),
    "vlp16_incidence": ModelLook("Incidence", "#E69F00"),
    "vlp16_measured": ModelLook("Measured", "#56B4E9"),
    "calibrated": ModelLook("Calibrated", "#332288"),
    "surface_normal": ModelLook("Surface normal", "#882255"),
    "beam_footprint": ModelLook("Beam footprint", "#999933"),
    "distance_table": ModelLook("Distance table", "#661100"),
    "vlp16_table51": ModelLook("VLP-16, Table\u00a05.1", "#6699CC"),
    "vlp16_fig518": ModelLook("VLP-16, as\u00a05.18", "#88CCEE"),
    "vlp16_divergence_fig518": ModelLook("Divergence, as\u00a05.18", "#44AA99"),
    "thesis_room": ModelLook("Thesis, rooms", "#117733"),
}

_OTHER_COLOURS = ("#44AA99", "#AA4499", "#8C6000", "#BB5566", "#5D4037", "#66CDAA")


def model_look(model: str, style: FigureStyle) -> ModelLook:
    """The look of an error model; one not in the table gets a colour from its name alone.

    The style's `colours` may name error models too.
    """
    known = MODEL_LOOKS.get(model)
    if known is None:
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
