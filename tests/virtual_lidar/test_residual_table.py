"""Columns about a plane against closed forms, and files of residuals."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pointkit.errors import InputError
from pointkit.geometry.ransac import Plane
from pointkit.tables import write_table
from virtual_lidar.residual_table import (
    COLUMNS,
    about_plane,
    joined,
    plane_coordinates,
    read_residuals,
)

ORIGIN = np.array([4.0, -3.0, 1.5])


@pytest.mark.parametrize(
    ("normal", "level", "uphill"),
    [
        ([0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
        ([0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]),
        ([-0.48, 0.64, 0.6], [-0.8, -0.6, 0.0], [0.36, -0.48, 0.8]),
        ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
        ([0.0008, 0.0, 1.0], [1.0, 0.0, -0.0008], [0.0, 1.0, 0.0]),
    ],
)
def test_places_on_a_plane_are_along_its_level_line_and_up_its_slope(
    normal: list[float], level: list[float], uphill: list[float]
) -> None:
    """From the sensor's foot, whatever the distance off it; on level planes along x and y."""
    plane = Plane(np.array(normal) / np.linalg.norm(normal), 0.7)
    foot = ORIGIN - plane.distances(ORIGIN[None])[0] * plane.normal
    places = np.array([[0.0, 0.0], [1.5, 0.0], [0.0, 2.5], [-3.0, 0.25]])
    off = np.array([0.0, 0.01, -0.02, 1.0])
    points = foot + places @ [level, uphill] + off[:, None] * plane.normal
    assert plane_coordinates(points, plane, ORIGIN) == pytest.approx(places, abs=2e-6)
    result = about_plane(points, plane, ORIGIN)
    assert result["residual_m"] == pytest.approx(off, abs=2e-6)
    assert result["plane_u_m"] == pytest.approx(places[:, 0], abs=2e-6)
    assert result["plane_v_m"] == pytest.approx(places[:, 1], abs=2e-6)
    # The foot is as far as the plane is, and the rest by Pythagoras.
    height = plane.distances(ORIGIN[None])[0] - off
    assert result["range_m"] == pytest.approx(np.hypot(height, np.hypot(*places.T)), abs=2e-6)
    assert {column.dtype for column in result.values()} == {np.dtype(np.float32)}


def table(model: str, *left_out: str) -> pd.DataFrame:
    columns = {name: [0.5, 1.5] for name in COLUMNS if name not in left_out}
    kinds = {"model": pd.Categorical([model] * 2), "surface": pd.Categorical(["wall", "floor"])}
    return pd.DataFrame({**columns, **kinds})


def test_a_table_comes_back_from_its_file_without_further_columns(tmp_path: Path) -> None:
    path, written = tmp_path / "a.parquet", table("real")
    write_table(written.assign(more=1.0)[["more", *reversed(COLUMNS)]], path)
    pd.testing.assert_frame_equal(read_residuals(path), written[list(COLUMNS)])


def test_an_older_table_lacks_the_columns_that_came_later(tmp_path: Path) -> None:
    path, later = tmp_path / "a.parquet", ("range_m", "frame", "plane_u_m", "plane_v_m")
    for some in (later, later[1:]):
        write_table(table("real", *some), path)
        assert list(read_residuals(path)) == [name for name in COLUMNS if name not in some]


def test_what_is_no_residual_table_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    with pytest.raises(InputError, match=r"a\.parquet: no such file"):
        read_residuals(path)
    path.write_bytes(b"PAR1 nothing")
    with pytest.raises(InputError, match=r"a\.parquet: not a readable table"):
        read_residuals(path)
    write_table(table("real", "run", "residual_m", "frame"), path)
    with pytest.raises(InputError, match=r"not a residual table, without run, residual_m$"):
        read_residuals(path)


def test_tables_of_several_models_are_joined_as_categories() -> None:
    both = joined([table("real"), table("vlp16")])
    assert both["model"].tolist() == ["real", "real", "vlp16", "vlp16"]
    assert list(both["model"].cat.categories) == ["real", "vlp16"]
    assert both["surface"].dtype == "category"
    assert both.index.tolist() == [0, 1, 2, 3]
