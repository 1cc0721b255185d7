import numpy as np
import pandas as pd
import pytest

from jenco2022.residuals.tables import compared_residuals, real_walls
from jenco2022.tables.model_distances import model_distances
from pointkit.errors import InputError
from tests.support.calibration_lookalike import residuals
from virtual_lidar import open_error_model


def capture(seed: int, **sigmas: float) -> pd.DataFrame:
    return residuals(seed, ray=(0.006, 0.0, 0.0), frames=3, **sigmas).assign(model="real")


def normal_residuals(model: str, sigma: float, replicates: int = 4) -> pd.DataFrame:
    rng = np.random.default_rng(len(model))
    rows = 20_000 * replicates
    return pd.DataFrame(
        {
            "model": model,
            "capture": 1,
            "distance_m": 2.0,
            "run": rng.integers(0, 5, rows),
            "laser_id": rng.integers(0, 16, rows),
            "replicate": np.repeat(np.arange(replicates), 20_000),
            "residual_m": sigma * rng.standard_normal(rows),
        }
    )


def test_the_distance_of_two_normal_distributions_is_that_of_their_sigmas() -> None:
    table = pd.concat([normal_residuals("real", 0.010), normal_residuals("vlp16", 0.016)])
    result = model_distances(table).set_index("model")
    # Wasserstein-1 of N(0, a) and N(0, b): |a - b| E|N(0, 1)|.
    expected = 0.006 * np.sqrt(2 / np.pi)
    row = result.loc["vlp16"]
    assert row["emd_m"] == pytest.approx(expected, rel=0.02)
    assert row["chance_m"] < 0.1 * expected
    assert result.loc["real", "emd_m"] == 0


def test_a_model_that_is_the_real_one_is_as_near_as_chance_allows() -> None:
    table = pd.concat([normal_residuals("real", 0.01, 1), normal_residuals("vlp16", 0.01, 30)])
    row = model_distances(table).set_index("model").loc["vlp16"]
    assert row["emd_m"] < 2 * row["chance_m"]


def test_without_errors_the_real_rays_have_no_residual() -> None:
    walls = real_walls([capture(1)])
    result = compared_residuals(walls, {"none": open_error_model("none")}, replicates=1)
    assert np.abs(result.loc[result["model"] == "none", "residual_m"]).max() < 1e-9


def test_a_models_residuals_on_the_real_rays_shrink_with_the_cosine() -> None:
    model = open_error_model("vlp16", {"bias_sigma_m": 0.0, "ray_sigma_m": 0.01})
    walls = real_walls([capture(2)])
    result = compared_residuals(walls, {"vlp16": model}, replicates=10)
    drawn = result[result["model"] == "vlp16"]
    expected = 0.01 * np.sqrt(np.mean(np.cos(drawn["incidence_rad"]) ** 2))
    assert drawn["residual_m"].std() == pytest.approx(expected, rel=0.02)


def test_tables_without_walls_of_captures_are_refused() -> None:
    with pytest.raises(InputError, match="no wall of a capture"):
        real_walls([residuals(5)])
    with pytest.raises(InputError, match="has no plane_u_m"):
        real_walls([capture(5).drop(columns="plane_u_m")])
    with pytest.raises(InputError, match="no real residuals"):
        model_distances(normal_residuals("vlp16", 0.01))
