"""Tables of chapter 5 against closed forms and against what the thesis prints."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import wasserstein_distance

from jenco2022 import published
from jenco2022.residuals.tables import JOINED, MAX_ROWS, joined_files
from jenco2022.tables.claims import claims
from jenco2022.tables.incidence_effect import incidence_effect, incidence_table
from jenco2022.tables.printed_tables import table_4_1, table_4_2, table_5_1
from jenco2022.tables.residual_statistics import residual_statistics
from jenco2022.tables.thesis_numbers import DISTANCE, FAR, NEAR, distance_to_normal, thesis_numbers
from pointkit.errors import InputError
from pointkit.seeding import generator
from puckbench.tables.registry import table_entries, table_entry
from tests.support.declared_columns import undeclared
from tests.support.figures_lookalike import gpcc_scales_table, thesis_medians_table
from tests.support.residuals_lookalike import residual_table

HALF_NORMAL = np.sqrt(2 / np.pi)
THESIS_4_2 = {  # as printed: laser 13 is missing
    0: (-15, 11.2),
    1: (1, -0.7),
    2: (-13, 9.7),
    3: (3, -2.2),
    4: (-11, 8.1),
    5: (5, -3.7),
    6: (-9, 6.6),
    7: (7, -5.1),
    8: (-7, 5.1),
    9: (9, -6.6),
    10: (-5, 3.7),
    11: (11, -8.1),
    12: (-3, 2.2),
    14: (-1, 0.7),
    15: (15, -11.2),
}


def residuals_of(std_m: dict[str, float], distance_m: float = 2.0) -> pd.DataFrame:
    """Normal residuals of models in three scans of a wall, at rising incidence."""
    rows = np.arange(30_000)
    tables = [
        pd.DataFrame(
            {
                "model": model,
                "surface": "wall",
                "distance_m": distance_m,
                "run": rows % 3,
                "laser_id": 0,
                "residual_m": std * generator(2, model).normal(size=len(rows)),
                "incidence_rad": published.LARGEST_RAD * rows / len(rows),
            }
        )
        for model, std in std_m.items()
    ]
    return pd.concat(tables, ignore_index=True)


def test_table_4_2_has_the_thesis_s_rows_and_the_one_it_drops() -> None:
    table = table_4_2().set_index("laser_id")
    rows = table[["elevation_deg", "vertical_correction_mm"]].apply(tuple, axis=1).to_dict()
    assert {laser: rows[laser] for laser in THESIS_4_2} == THESIS_4_2
    assert set(rows) - set(THESIS_4_2) == {13}
    assert rows[13] == (13, -9.7)
    assert table.index[table["note"] != ""].tolist() == [13]


def test_table_4_1_agrees_with_the_thesis_where_it_says_so() -> None:
    table = table_4_1().set_index("quantity")
    same = table.index[table["thesis"] == table["here"]].tolist()
    assert same == ["Wavelength", "Pulse length", "Field of view (vertical)", *_HORIZONTAL]
    assert (table.loc[table["thesis"] != table["here"], "note"] != "").all()
    # 3.0 and 1.5 mrad are the degrees rounded, or the other way round.
    beams = table.loc[["Beam divergence (horizontal)", "Beam divergence (vertical)"], "here"]
    assert beams.tolist() == ["3.14 mrad (0.18\u00b0)", "1.57 mrad (0.09\u00b0)"]


_HORIZONTAL = ["Field of view (horizontal)"]


def test_table_5_1_shows_both_sets_of_sigmas() -> None:
    table = table_5_1().set_index("quantity")
    sigmas = table.loc[["Distance bias sigma", "Per-ray noise sigma"]]
    assert sigmas["thesis"].tolist() == sigmas["as_printed"].tolist() == ["0.078 m", "0.014 m"]
    assert sigmas["here"].tolist() == ["0.014 m", "0.01 m"]
    others = table.drop(sigmas.index)
    assert [float(text.split()[0]) for text in others["thesis"]] == [
        float(text.split()[0]) for text in others["here"]
    ]


@pytest.mark.parametrize(("mean", "std"), [(0.003, 0.0138), (0.0007, 0.02), (0.0, 0.005)])
def test_the_distance_to_a_normal_distribution_is_the_area_between(mean: float, std: float) -> None:
    sample = mean + std * generator(1, "sample").normal(size=40_000)
    reference = 0.0007 + 0.0138 * generator(1, "reference").normal(size=400_000)
    expected = wasserstein_distance(sample, reference)
    assert distance_to_normal(sample, 0.0007, 0.0138) == pytest.approx(expected, abs=1e-4)


def test_distances_in_closed_form() -> None:
    assert distance_to_normal(np.zeros(9999), 0, 0.0138) == pytest.approx(
        0.0138 * HALF_NORMAL, rel=1e-3
    )
    wide = 0.0652 * generator(1, "wide").normal(size=200_000)
    assert distance_to_normal(wide, 0, 0.0138) == pytest.approx(0.0514 * HALF_NORMAL, rel=0.02)
    with pytest.raises(InputError, match="nonempty"):
        distance_to_normal(np.zeros(0), 0, 1)


def test_the_thesis_s_distances_are_those_of_normal_distributions() -> None:
    """So a normal distribution may stand for the real residuals, which are not published."""
    for model, std in published.MODEL_STDS_M.items():
        expected = abs(std - published.REAL_STD_M) * HALF_NORMAL
        assert published.MODEL_DISTANCES_M[model] == pytest.approx(expected, abs=0.0012)


def test_the_thesis_s_numbers_stand_beside_ours() -> None:
    near = residuals_of({"hdl64e": 0.06, "vlp16_fig518": 0.02, "mine": 0.01})
    far = residuals_of({"vlp16_fig518": 0.016}, 30.0)
    table = thesis_numbers(pd.concat([near, far])).set_index(["quantity", "model"])
    assert table.loc[(NEAR, "hdl64e"), "thesis_m"] == 0.0652
    assert table.loc[(NEAR, "hdl64e"), "here_m"] == pytest.approx(0.06, rel=0.02)
    assert table.loc[(FAR, "vlp16_fig518"), "thesis_m"] == 0.0163
    assert table.loc[(FAR, "vlp16_fig518"), "here_m"] == pytest.approx(0.016, rel=0.02)
    assert table.loc[(DISTANCE, "vlp16_fig518"), "thesis_m"] == 0.0044
    assert np.isnan(table.loc[(NEAR, "mine"), "thesis_m"])
    assert (FAR, "mine") not in table.index


def test_the_incidence_bins_are_the_thesis_s() -> None:
    table = incidence_table(residuals_of({"vlp16": 0.014}))
    assert table["high_rad"].tolist() == pytest.approx(np.arange(1, 11) * 0.1315)
    assert table["std_m"].tolist() == pytest.approx([0.014] * 10, rel=0.06)
    assert table["thesis_real_std_m"].tolist()[::9] == [0.0118, 0.0246]


def test_the_effect_of_incidence_in_closed_form() -> None:
    residuals = residuals_of({"m": 0.01})
    angle = residuals["incidence_rad"].to_numpy()
    error = residuals["residual_m"].to_numpy() / np.cos(angle)
    parts = {"range_error_m": error, "incidence_rad": angle, "x_m": 0.0, "z_m": 0.5}
    scans = residuals[["model", "surface", "distance_m"]].assign(
        **parts, y_m=residuals["residual_m"]
    )
    table = incidence_effect(scans, residuals)
    for column in ("surface_distance_std_m", "plane_residual_std_m"):
        assert table[column].tolist() == pytest.approx([0.01] * 10, rel=0.06)
    low, high = table["low_rad"], table["high_rad"]
    squares = 0.5 + (np.sin(2 * high) - np.sin(2 * low)) / (4 * (high - low))
    assert table["rms_cos"].tolist() == pytest.approx(np.sqrt(squares), rel=1e-3)
    product = table["range_error_std_m"] * table["rms_cos"]
    assert table["predicted_std_m"].tolist() == pytest.approx(product.tolist())
    # The cosine hardly varies within a bin, so the product is the residual's spread.
    assert product[:8].tolist() == pytest.approx([0.01] * 8, rel=0.06)


def test_joined_tables_have_the_names_of_the_configuration(tmp_path: Path) -> None:
    table = residuals_of({"vlp16": 0.014}).assign(elevation_deg=1.0, frame=3)
    table.to_parquet(tmp_path / "a.parquet")
    files = [(name, tmp_path / "a.parquet") for name in ("first", "real", "real")]
    joined = joined_files(files, "residuals")
    assert tuple(joined) == JOINED["residuals"]
    assert joined["model"].value_counts().to_dict() == {"first": 30_000, "real": 60_000}
    table.drop(columns="run").to_parquet(tmp_path / "b.parquet")
    with pytest.raises(InputError, match=r"b\.parquet: no column 'run'"):
        joined_files([("b", tmp_path / "b.parquet")], "residuals")


def test_a_long_capture_is_subsampled(tmp_path: Path) -> None:
    rows = pd.DataFrame(dict.fromkeys(JOINED["residuals"], 0), index=range(MAX_ROWS + 1000))
    rows.assign(run=np.arange(len(rows))).to_parquet(tmp_path / "long.parquet")
    joined = joined_files([("real", tmp_path / "long.parquet")], "residuals")
    assert len(joined) == MAX_ROWS
    assert joined["run"].is_monotonic_increasing
    assert joined["run"].is_unique


def test_every_table_can_be_loaded_and_an_unknown_one_is_named() -> None:
    assert all(callable(entry.make) for entry in table_entries().values())
    with pytest.raises(InputError, match=r"unknown table 'table_6_1' \(known: .*table_4_1, "):
        table_entry("table_6_1")


def test_every_column_of_the_thesis_s_tables_is_declared() -> None:
    residuals = residual_table()
    scans = residuals.assign(y_m=0.0, z_m=0.0, range_error_m=residuals["residual_m"])
    tables = [
        *(table_4_1(), table_4_2(), table_5_1(), incidence_table(residuals)),
        *(incidence_effect(scans, residuals), residual_statistics(residuals)),
        *(thesis_numbers(residuals), gpcc_scales_table(), thesis_medians_table()),
        claims(datasets={}, codecs={}),
    ]
    assert undeclared(tables) == set()
