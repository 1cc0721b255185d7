"""Colours of error models differ from each other, from those of codecs and of data sets."""

from itertools import combinations

import numpy as np
import pytest

from jenco2022.figures.model_styles import MODEL_STYLES
from puckbench.codecs.registry import codecs
from puckbench.figures.plot_styles import DATASET_COLOURS, codec_style
from tests.support.colours import DEUTERANOPIA, NORMAL, PROTANOPIA, lab

COLOURS = [plot_style.colour for plot_style in MODEL_STYLES.values()]


def test_error_models_wear_no_colour_of_codecs_and_data_sets() -> None:
    labs = [lab(codec_style(name).colour, NORMAL) for name in codecs()]
    for colour in COLOURS:
        assert min(np.linalg.norm(lab(colour, NORMAL) - other) for other in labs) > 10
    assert not set(COLOURS) & set(DATASET_COLOURS)


@pytest.mark.parametrize("vision", [NORMAL, PROTANOPIA, DEUTERANOPIA])
def test_error_models_are_told_apart_by_everyone(vision: list[list[float]]) -> None:
    for a, b in combinations(COLOURS, 2):
        assert np.linalg.norm(lab(a, vision) - lab(b, vision)) > 12, (a, b)
