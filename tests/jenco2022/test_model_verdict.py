import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from jenco2022.figures.model_styles import MODEL_STYLES
from jenco2022.figures.model_verdict import draw_verdict
from pointkit.errors import InputError
from puckbench.figures.style import FigureStyle

SIGMAS = {"real": 0.011, "hdl64e": 0.07, "vlp16": 0.015, "vlp16_measured": 0.009}


def residuals() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    parts = [
        pd.DataFrame({"model": model, "residual_m": sigma * rng.standard_normal(3000)})
        for model, sigma in SIGMAS.items()
    ]
    return pd.concat(parts, ignore_index=True)


def distances() -> pd.DataFrame:
    rows = [
        {
            "model": model,
            "std_m": sigma,
            "emd_m": abs(sigma - 0.011),
            "emd_low_m": 0.8 * abs(sigma - 0.011),
            "emd_high_m": 1.3 * abs(sigma - 0.011),
            "chance_m": np.nan if model == "real" else 0.0005,
        }
        for model, sigma in SIGMAS.items()
    ]
    return pd.DataFrame(rows)


def drawn(table: pd.DataFrame, measured: pd.DataFrame) -> Figure:
    style = FigureStyle()
    with style.context():
        return draw_verdict(table, measured, style)


def test_each_model_has_a_density_of_area_one_and_its_distance_written() -> None:
    above, below = drawn(residuals(), distances()).axes
    lines = {line.get_color(): line for line in above.get_lines()}
    for model in SIGMAS:
        x, y = lines[MODEL_STYLES[model].colour].get_data()
        assert np.trapezoid(y, x) == pytest.approx(1, rel=0.02)
    assert [text.get_text() for text in below.texts] == ["59.0", "4.0", "2.0"]
    assert [tick.get_text() for tick in below.get_yticklabels()] == [
        "HDL-64E",
        "VLP-16",
        "Measured",
    ]


def test_a_single_replicate_has_no_strip_of_chance() -> None:
    _, below = drawn(residuals(), distances().assign(chance_m=np.nan)).axes
    assert not below.patches


def test_without_real_residuals_there_is_no_verdict() -> None:
    table = residuals()
    with pytest.raises(InputError, match="no real residuals"):
        drawn(table[table["model"] != "real"], distances())
    with pytest.raises(InputError, match="no residual of the model 'vlp16'"):
        drawn(table[table["model"] != "vlp16"], distances())
