"""Colours and titles that stay the same, and styles from configurations."""

import subprocess
import sys
from itertools import combinations

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.codecs.registry import codecs
from puckbench.figures.plot_styles import (
    _OTHER_COLOURS,
    DATASET_COLOURS,
    OTHER_MODEL_COLOURS,
    codec_style,
    error_model_colour,
)
from puckbench.figures.registry import figure_entries, figure_entry
from puckbench.figures.style import FigureStyle
from tests.support.colours import DEUTERANOPIA, NORMAL, PROTANOPIA, lab
from virtual_lidar.errors import error_model_names


@pytest.mark.parametrize("vision", [NORMAL, PROTANOPIA, DEUTERANOPIA])
def test_the_thesis_codecs_are_told_apart_by_everyone(vision: list[list[float]]) -> None:
    default = ("draco", "gpcc", "pcgcv1_plus", "pcgcv2_plus")
    thesis = ("draco", "gpcc", "pcgcv1", "pcgcv2")
    for a, b in (*combinations(default, 2), *combinations(thesis, 2)):
        plot_styles = codec_style(a), codec_style(b)
        distance = np.linalg.norm(np.subtract(*(lab(k.colour, vision) for k in plot_styles)))
        assert distance > 15, (a, b)


def test_every_known_codec_has_its_own_colour_and_marker() -> None:
    styles = [codec_style(name) for name in codecs()]
    assert len({k.colour for k in styles}) == len(styles)
    assert len({(k.marker, k.line) for k in styles}) == len(styles)


def test_error_models_and_data_sets_wear_no_codecs_colour() -> None:
    codecs_labs = [lab(codec_style(name).colour, NORMAL) for name in codecs()]
    codecs_labs += [lab(colour, NORMAL) for colour in _OTHER_COLOURS]
    models = [error_model_colour(name) for name in error_model_names()]
    for colour in {*models, *OTHER_MODEL_COLOURS, *DATASET_COLOURS}:
        assert min(np.linalg.norm(lab(colour, NORMAL) - other) for other in codecs_labs) > 10
    assert not {*models, *OTHER_MODEL_COLOURS} & set(DATASET_COLOURS)


@pytest.mark.parametrize("vision", [NORMAL, PROTANOPIA, DEUTERANOPIA])
def test_data_sets_are_told_apart_by_everyone(vision: list[list[float]]) -> None:
    for a, b in combinations(DATASET_COLOURS, 2):
        assert np.linalg.norm(lab(a, vision) - lab(b, vision)) > 30, (a, b)


def test_a_data_set_keeps_its_colour_when_another_is_not_drawn() -> None:
    style = FigureStyle(datasets=("objects", "rooms"))
    both = style.of_datasets(["rooms", "objects", "extra"])
    assert list(both) == ["objects", "rooms", "extra"]
    assert style.of_datasets(["rooms"])["rooms"] == both["rooms"]


def test_an_unknown_codec_looks_the_same_in_every_process() -> None:
    code = "from puckbench.figures.plot_styles import codec_style as c; print(c('my_codec'))"
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert printed.strip() == str(codec_style("my_codec"))


def test_every_registered_function_exists() -> None:
    assert all(callable(entry.draw) for entry in figure_entries().values())


def test_an_unknown_figure_is_named() -> None:
    with pytest.raises(InputError, match=r"unknown figure 'fig_7_1' \(known: .*truth_rd, "):
        figure_entry("fig_7_1")


def test_later_options_override_earlier_ones_key_by_key() -> None:
    common = {"font_size": 9, "colours": {"draco": "navy", "gpcc": "red"}}
    own = {"font_size": 6, "colours": {"gpcc": "#123456"}, "axis_ranges": {"bpp": [0.1, 10]}}
    style = FigureStyle.from_config(common, own)
    assert style.font_size == 6
    assert (style.of_codec("draco").colour, style.of_codec("gpcc").colour) == ("navy", "#123456")
    assert style.axis_ranges["bpp"] == (0.1, 10)


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"fontsize": 9}, "unknown option 'fontsize' .*did you mean 'font_size'"),
        ({"font_size": 0}, "font_size is 0, but must be greater than 0"),
        ({"font_size": "big"}, "font_size is 'big', but must be a valid number"),
        ({"axis_ranges": {"bpp": [0, 10]}}, "axis_ranges: 'bpp' must be .low, high."),
        ({"axis_ranges": {"bpp": 10}}, "axis_ranges.bpp is 10, but must be"),
        ({"colours": {"draco": "bleu"}}, "'bleu' is not a colour"),
        ({"colours": "red"}, "colours is 'red', but must be a valid dictionary"),
    ],
)
def test_a_wrong_option_is_named(options: dict[str, object], fault: str) -> None:
    with pytest.raises(InputError, match=f"figure style: .*{fault}"):
        FigureStyle.from_config(options)


def test_data_sets_keep_the_table_s_order_unless_the_style_names_one() -> None:
    table = ["rooms", "rooms", "objects", "extra"]
    assert FigureStyle().ordered_datasets(table) == ["rooms", "objects", "extra"]
    style = FigureStyle(datasets=("objects", "absent"))
    assert style.ordered_datasets(table) == ["objects", "rooms", "extra"]
