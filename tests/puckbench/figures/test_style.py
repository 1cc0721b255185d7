"""Colours and titles that stay the same, and styles from configurations."""

import subprocess
import sys
from itertools import combinations

import numpy as np
import pytest

from jenco2022.figures.model_styles import MODEL_STYLES
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
from virtual_lidar.errors import error_model_names

# Machado et al. 2009, severity 1.0: linear RGB as seen with protanopia and deuteranopia.
_PROTANOPIA = [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]
_DEUTERANOPIA = [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]
_NORMAL = np.eye(3).tolist()
_TO_XYZ = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]


def _lab(colour: str, vision: list[list[float]]) -> np.ndarray:
    srgb = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    xyz = np.array(_TO_XYZ) @ np.clip(np.array(vision) @ linear, 0, 1) / [0.9505, 1, 1.089]
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("vision", [_NORMAL, _PROTANOPIA, _DEUTERANOPIA])
def test_the_thesis_codecs_are_told_apart_by_everyone(vision: list[list[float]]) -> None:
    default = ("draco", "gpcc", "pcgcv1_plus", "pcgcv2_plus")
    thesis = ("draco", "gpcc", "pcgcv1", "pcgcv2")
    for a, b in (*combinations(default, 2), *combinations(thesis, 2)):
        plot_styles = codec_style(a), codec_style(b)
        distance = np.linalg.norm(np.subtract(*(_lab(k.colour, vision) for k in plot_styles)))
        assert distance > 15, (a, b)


def test_every_known_codec_has_its_own_colour_and_marker() -> None:
    styles = [codec_style(name) for name in codecs()]
    assert len({k.colour for k in styles}) == len(styles)
    assert len({(k.marker, k.line) for k in styles}) == len(styles)


def test_error_models_and_data_sets_wear_no_codecs_colour() -> None:
    codecs_labs = [_lab(codec_style(name).colour, _NORMAL) for name in codecs()]
    codecs_labs += [_lab(colour, _NORMAL) for colour in _OTHER_COLOURS]
    models = [error_model_colour(name) for name in error_model_names()]
    models += [plot_style.colour for plot_style in MODEL_STYLES.values()]
    for colour in {*models, *OTHER_MODEL_COLOURS, *DATASET_COLOURS}:
        assert min(np.linalg.norm(_lab(colour, _NORMAL) - other) for other in codecs_labs) > 10
    assert not {*models, *OTHER_MODEL_COLOURS} & set(DATASET_COLOURS)


@pytest.mark.parametrize("vision", [_NORMAL, _PROTANOPIA, _DEUTERANOPIA])
def test_data_sets_and_error_models_are_told_apart_by_everyone(vision: list[list[float]]) -> None:
    for colours, least in (
        (DATASET_COLOURS, 30),
        ([plot_style.colour for plot_style in MODEL_STYLES.values()], 12),
    ):
        for a, b in combinations(colours, 2):
            assert np.linalg.norm(_lab(a, vision) - _lab(b, vision)) > least, (a, b)


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
    with pytest.raises(InputError, match=r"unknown figure 'fig_7_1' \(known: .*fig_5_1, "):
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
