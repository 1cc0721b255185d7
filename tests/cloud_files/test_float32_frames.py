"""Detection of the number of columns of bare values."""

from pathlib import Path

import numpy as np
import pytest

from cloud_files.float32_frames import (
    check_column_count,
    detect_column_count,
    read_float32_frame,
)
from pointkit.errors import InputError

RNG = np.random.default_rng(1)


def scan(points: int) -> np.ndarray:
    """Points around a sensor in the order of its rotation, with intensity, ring and time."""
    around = np.sort(RNG.uniform(0, 2 * np.pi, points))
    ranges = RNG.uniform(2, 60, points)
    level = ranges * np.cos(np.radians(RNG.uniform(-24, 2, points)))
    xyz = np.column_stack(
        [level * np.cos(around), level * np.sin(around), RNG.uniform(-3, 5, points)]
    )
    more = [RNG.uniform(0, 1, points), np.arange(points) % 32, np.linspace(0, 0.1, points)]
    return np.column_stack([xyz, *more]).astype("<f4")


@pytest.mark.parametrize("columns", [3, 4, 5, 6])
@pytest.mark.parametrize("points", [20, 200, 20_000])
@pytest.mark.parametrize("is_shuffled", [False, True])
def test_the_number_of_columns_is_detected(columns: int, points: int, is_shuffled: bool) -> None:
    rows = scan(points)[:, :columns]
    rows = RNG.permutation(rows) if is_shuffled else rows
    if is_shuffled and points < 20_000:  # chance has its part in so few values
        assert detect_column_count(rows.ravel()) in (columns, None)
    else:
        assert detect_column_count(rows.ravel()) == columns


def test_missing_returns_and_zero_intensities_do_not_disturb_the_detection() -> None:
    rows = scan(2000)[:, :5]
    rows[RNG.random(2000) < 0.4, :3] = 0
    assert detect_column_count(rows.ravel()) == 5
    rows = scan(2000)[:, :4]
    rows[:, 3] = 0
    assert detect_column_count(rows.ravel()) == 4
    rows[7] = np.nan
    assert detect_column_count(rows.ravel()) == 4


def test_unordered_values_have_no_detectable_columns() -> None:
    assert detect_column_count(RNG.random(9000)) is None
    assert detect_column_count(scan(9)[:, :4].ravel()) is None  # 36 values


def test_a_frame_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    data = scan(100)[:, :5].tobytes()
    check_column_count(path, data, 5)
    check_column_count(path, b"", 4)
    with pytest.raises(InputError, match=r"a\.bin: its points have 5 values each, not 4"):
        check_column_count(path, data, 4)


def test_only_coordinates_of_a_sensor_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    for value, is_taken in [(9e4, True), (1.1e5, False), (1e-19, True), (1e-21, False)]:
        np.array([value, 2, 3, 0.5], dtype="<f4").tofile(path)
        if is_taken:
            assert read_float32_frame(path)["x"].tolist() == [np.float32(value)]
        else:
            with pytest.raises(InputError, match="no frame of a LiDAR in rows of 4"):
                read_float32_frame(path)


@pytest.mark.parametrize(
    ("row", "names"),
    [
        ((1, 2, 3, 0.5), ["intensity"]),
        ((1, 2, 3, -0.5), ["intensity"]),  # no other number of columns is whole
        ((1, 2, 3, 0.5, 127), ["intensity", "ring"]),
        ((1, 2, 3, 0.5, 128), ["intensity", "time"]),
        ((1, 2, 3, 0.5, -1), ["intensity", "time"]),
        ((1, 2, 3), []),
    ],
)
def test_columns_of_a_single_point(
    tmp_path: Path, row: tuple[float, ...], names: list[str]
) -> None:
    np.array(row, dtype="<f4").tofile(tmp_path / "a.bin")
    assert list(read_float32_frame(tmp_path / "a.bin")) == ["x", "y", "z", *names]


def test_few_values_tell_nothing_where_two_layouts_fit(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    np.array([1, 2, 3, 0.5, 31, 0.1], dtype="<f4").tofile(path)
    with pytest.raises(InputError, match=r"may have 3 or 6 values each: .*--bin-columns"):
        read_float32_frame(path)
    np.array([1, 2, 3, 0.5, 31.5, 0.1], dtype="<f4").tofile(path)  # no ring
    assert list(read_float32_frame(path)) == ["x", "y", "z"]
    assert list(read_float32_frame(path, "6")) == ["x", "y", "z", "intensity", "ring", "time"]


def test_columns_beyond_the_ring_and_the_time_are_numbered(tmp_path: Path) -> None:
    rows = scan(200)
    rows[:, 4] += 0.5
    rows.tofile(tmp_path / "a.bin")
    assert list(read_float32_frame(tmp_path / "a.bin"))[3:] == ["intensity", "time", "column_6"]


def test_negative_intensities_are_not_likely_but_possible(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    rows = np.tile(np.array([1, 2, 3, -0.5], dtype="<f4"), (5, 1))
    rows.tofile(path)
    with pytest.raises(InputError, match=r"may have 4 or 5 values each"):
        read_float32_frame(path)
    rows[:4].tofile(path)
    assert list(read_float32_frame(path))[3:] == ["intensity"]
    rows[:, 3] *= -1
    rows.tofile(path)
    assert list(read_float32_frame(path))[3:] == ["intensity"]
