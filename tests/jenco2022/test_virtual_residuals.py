from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jenco2022.residuals.virtual import SWEEP, Procedure, residual_table, scan_residuals
from pointkit.errors import InputError
from pointkit.geometry.ransac import Plane
from pointkit.tables import write_table
from puckbench.cli import main
from virtual_lidar.residual_table import COLUMNS, plane_coordinates, read_residuals

COARSE = SWEEP.replaced(azimuth_step_deg=0.5)
RAY_NOISE = {"bias_sigma_m": 0.0, "ray_sigma_m": 0.01}


def coarse(model: str, **settings: object) -> Procedure:
    return replace(Procedure(model, sweep=COARSE), **settings)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def ray_noise() -> pd.DataFrame:
    """Ray noise of 10 mm alone, planes refitted to all points: their own error is nothing."""
    fitted = coarse("vlp16", options=RAY_NOISE, threshold_m=0.1, refit=True)
    return scan_residuals(fitted, 2, 1, seed=3)


@pytest.mark.parametrize("distance", [1, 3, 30])
def test_a_scan_without_errors_has_no_residual(distance: float) -> None:
    table = scan_residuals(coarse("none"), distance, 1, seed=0)
    assert np.abs(table["residual_m"]).max() < 1e-6


@pytest.mark.parametrize("distance", [1.0, 3.0, 5.0])
def test_the_largest_incidence_is_that_of_the_surfaces_corners(distance: float) -> None:
    table = scan_residuals(coarse("none"), distance, 1, seed=0)
    largest = table.groupby("surface", observed=True)["incidence_rad"].max()
    # The sensor is 1 m high; the wall is 2.2 m high, both are 1.6 m wide.
    wall, floor = np.arctan(np.hypot(0.8, 1.2) / distance), np.arctan(np.hypot(0.8, distance))
    for surface, corner in (("wall", wall), ("floor", floor)):
        assert corner - 0.03 < largest[surface] <= corner + 1e-6


def test_residuals_at_normal_incidence_spread_as_the_ray_noise(ray_noise: pd.DataFrame) -> None:
    head_on = ray_noise[ray_noise["incidence_rad"] < 0.14]
    assert set(head_on["surface"]) == {"wall"}
    assert head_on["residual_m"].std() == pytest.approx(0.01, rel=0.04)


def test_residuals_shrink_with_the_cosine_of_the_incidence(ray_noise: pd.DataFrame) -> None:
    bins = np.round(ray_noise["incidence_rad"], 1)
    for _, rows in ray_noise.groupby(["surface", bins], observed=True):
        if len(rows) > 1500:
            expected = 0.01 * np.sqrt(np.mean(np.cos(rows["incidence_rad"]) ** 2))
            assert rows["residual_m"].std() == pytest.approx(expected, rel=0.08)


def test_bias_and_ray_noise_add_in_squares() -> None:
    table = scan_residuals(coarse("vlp16", threshold_m=0.1, refit=True), 3, 1, seed=3)
    scale = np.hypot(0.014, 0.010) * np.sqrt(np.mean(np.cos(table["incidence_rad"]) ** 2))
    assert table["residual_m"].std() == pytest.approx(scale, rel=0.06)


def test_residuals_are_positive_where_the_measured_range_is_short() -> None:
    short = {"bias_sigma_m": 0.0, "ray_sigma_m": 1e-6, "ray_mean_m": -0.05}
    table = scan_residuals(coarse("vlp16", options=short, refit=True), 2, 1, seed=3)
    wall = table[table["surface"] == "wall"]
    # A short range moves a head-on point nearer to the sensor than a slanting one.
    near, far = wall["incidence_rad"] < 0.1, wall["incidence_rad"] > 0.5
    assert wall.loc[near, "residual_m"].mean() > wall.loc[far, "residual_m"].mean()


def test_columns_and_their_values() -> None:
    table = residual_table(coarse("none"), [1, 3], runs=2, seed=0)
    assert tuple(table.columns) == COLUMNS
    assert list(table["surface"].cat.categories) == ["wall", "floor"]
    assert set(zip(table["distance_m"], table["run"], strict=True)) == {
        (1, 1),
        (1, 2),
        (3, 1),
        (3, 2),
    }
    # Velodyne's table: laser 0 looks 15 degrees down, laser 15 as much up, laser 1 one up.
    elevation = table.groupby("laser_id")["elevation_deg"].unique()
    assert [elevation[laser] for laser in (0, 1, 15)] == [[-15], [1], [15]]
    assert table.memory_usage(index=False, deep=True).sum() < 40 * len(table)


def test_range_and_place_on_the_plane_tell_the_point() -> None:
    table = scan_residuals(coarse("none"), 3, 1, seed=0)
    for surface, height in (("wall", 3.0), ("floor", 1.0)):
        rows = table[table["surface"] == surface]
        u, v, far, angle = rows[["plane_u_m", "plane_v_m", "range_m", "incidence_rad"]].to_numpy().T
        assert np.hypot(np.hypot(u, v), height) == pytest.approx(far, abs=1e-5)
        assert np.arctan2(np.hypot(u, v), height) == pytest.approx(angle, abs=1e-5)
    assert set(table["frame"]) <= set(range(480))
    assert table.groupby("surface", observed=True)["frame"].is_monotonic_increasing.all()


def test_another_plane_is_a_linear_function_of_the_place_away() -> None:
    rng, origin = np.random.default_rng(0), np.array([0.3, 0.1, 1.0])
    normal = np.array([1.0, -2.0, 0.4]) / np.linalg.norm([1.0, -2.0, 0.4])
    plane, turned = Plane(normal, 0.7), normal + np.array([2e-4, 1e-4, -3e-4])
    other = Plane(turned / np.linalg.norm(turned), 0.701)
    points = rng.normal(size=(50, 3))
    points -= plane.distances(points)[:, None] * normal
    u, v = plane_coordinates(points, plane, origin).T
    terms = np.column_stack([np.ones(50), u, v])
    _, rest, rank, _ = np.linalg.lstsq(terms, other.distances(points), rcond=None)
    assert rank == 3
    assert rest[0] < 1e-12
    # The second axis goes up, the first is level: heights do not change along it.
    heights = points[:, 2] - v * np.sqrt(1 - normal[2] ** 2)
    assert np.ptp(heights) == pytest.approx(0, abs=1e-12)


def test_an_older_table_is_read_with_the_columns_it_has(tmp_path: Path) -> None:
    table = scan_residuals(coarse("none"), 3, 1, seed=0)
    older = table[list(COLUMNS[:8])]
    write_table(older, tmp_path / "old.parquet")
    pd.testing.assert_frame_equal(read_residuals(tmp_path / "old.parquet"), older)


def test_a_scan_depends_on_seed_distance_and_run_alone() -> None:
    table = residual_table(coarse("vlp16"), [1, 3], runs=2, seed=7)
    alone = scan_residuals(coarse("vlp16"), 3, 2, seed=7)
    within = table[(table["distance_m"] == 3) & (table["run"] == 2)].reset_index(drop=True)
    pd.testing.assert_frame_equal(within, alone)
    other = scan_residuals(coarse("vlp16"), 3, 2, seed=8)
    assert not np.array_equal(other["residual_m"], alone["residual_m"])
    first = table[(table["distance_m"] == 3) & (table["run"] == 1)]
    assert not np.array_equal(first["residual_m"], alone["residual_m"])


def test_kept_rows_are_rows_of_the_whole_table() -> None:
    whole = scan_residuals(coarse("vlp16"), 3, 1, seed=7)
    kept = scan_residuals(coarse("vlp16", keep=100), 3, 1, seed=7)
    assert len(kept) == 100
    assert len(kept.merge(whole, on=list(COLUMNS))) == 100


def test_the_command_writes_the_table(tmp_path: Path) -> None:
    out = tmp_path / "r.parquet"
    words = ["--model", "vlp16", "--distances", "1", "--runs", "1", "--keep", "50", "--seed", "4"]
    assert main(["residuals", str(out), *words]) == 0
    expected = residual_table(Procedure("vlp16", keep=50), [1.0], runs=1, seed=4)
    pd.testing.assert_frame_equal(read_residuals(out), expected)


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["--distances", "1.7"], "unknown calibration scene 'wall_floor_1.7m'"),
        (["--model", "wobble"], "unknown error model 'wobble'"),
    ],
)
def test_bad_settings_are_one_line_and_leave_nothing(
    words: list[str], fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["residuals", str(tmp_path / "r.parquet"), *words]) == 2
    error = capsys.readouterr().err
    assert fault in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_files_that_are_no_residual_tables_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.parquet").write_text("none")
    write_table(pd.DataFrame({"model": ["none"]}), tmp_path / "other.parquet")
    for name, fault in (
        ("none", "no such file"),
        ("text", "not a readable table"),
        ("other", "without surface"),
    ):
        with pytest.raises(InputError, match=fault):
            read_residuals(tmp_path / f"{name}.parquet")
