"""Rounding to G-PCC's grid, and the bytes that puckbench puts before a stream."""

import numpy as np
import pytest

from gpcc.grid import MAGIC, InputGrid, input_coordinates, input_grid, quantise, unwrap, wrap
from pointkit.errors import InputError

COLUMN = np.array([[-2.5, 0, 0], [-0.6, 0, 0], [0.4, 0, 0], [0.5, 0, 0], [1.75, 0, 0]])


def _rounded(scale: float, rounding: str) -> list[int]:
    positions, origin = quantise(COLUMN, InputGrid(), scale, rounding)  # type: ignore[arg-type]
    assert positions.min() == 0
    return list((positions + origin)[:, 0])


def test_nearest_rounds_once_halves_away_from_zero() -> None:
    assert _rounded(1, "nearest") == [-3, -1, 0, 1, 2]
    assert _rounded(0.5, "nearest") == [-1, 0, 0, 0, 1]
    assert _rounded(4, "nearest") == [-10, -2, 2, 2, 7]


def test_truncation_goes_towards_zero_before_the_scale() -> None:
    assert _rounded(1, "truncate") == [-2, 0, 0, 0, 1]
    assert _rounded(0.5, "truncate") == [-1, 0, 0, 0, 1]


@pytest.mark.parametrize("scale", [0.125, 0.375, 1 / 3, 1, 16])
@pytest.mark.parametrize("unit", [1.0, 0.001])
@pytest.mark.parametrize("shift", [0.0, -5e5, 1e12])
def test_points_come_back_within_half_a_step(scale: float, unit: float, shift: float) -> None:
    points = np.random.default_rng(0).random((100, 3)) * 1000 * unit + shift
    grid = input_grid(points, unit, scale)
    positions, origin = quantise(points, grid, scale, "nearest")
    back = input_coordinates((positions + origin) / scale, grid)
    rounding_errors = 2 * np.spacing(np.abs(points).max())
    assert np.abs(back - points).max() <= unit / scale / 2 * (1 + 1e-9) + rounding_errors


def test_whole_coordinates_come_back_exactly() -> None:
    points = np.array([[-7.0, 3.0, 2.0**29], [5.0, 0.0, 2.0**29 - 1]])
    positions, origin = quantise(points, input_grid(points, 1.0, 1.0), 1.0, "nearest")
    assert (positions + origin == points).all()


@pytest.mark.parametrize("widest", [2.0**21, 1e300, 1.7e308])
def test_clouds_that_span_too_many_bits_are_refused(widest: float) -> None:
    points = np.array([[-widest, 0, 0], [widest, 0, 0]])
    with pytest.raises(InputError, match="more than 21 bits at scale 1"):
        quantise(points, input_grid(points, 1.0, 1.0), 1.0, "nearest")


@pytest.mark.parametrize("grid", [InputGrid(), InputGrid(0.001), InputGrid(1.0, (1e12, -3.0, 0.5))])
def test_stream_and_grid_come_back(grid: InputGrid) -> None:
    assert unwrap(wrap(b"stream", grid)) == (b"stream", grid)


def test_the_inputs_own_frame_takes_five_bytes() -> None:
    assert wrap(b"stream", InputGrid()) == MAGIC + b"\0stream"


def test_a_bare_stream_has_the_inputs_own_frame() -> None:
    bare = b"\0\0\0\0\x09rest"
    assert unwrap(bare) == (bare, InputGrid())


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b"", "not a G-PCC stream"),
        (b"ply\n", "not a G-PCC stream"),
        (MAGIC, "first bytes are damaged"),
        (MAGIC + b"\2", "first bytes are damaged"),
        (MAGIC + b"\1" + bytes(31), "first bytes are damaged"),
        (MAGIC + b"\1" + bytes(32), "not finite"),
        (MAGIC + b"\1" + b"\xff" * 32, "not finite"),
    ],
)
def test_damaged_containers_are_refused(data: bytes, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        unwrap(data)


def test_a_frame_beyond_double_precision_is_refused() -> None:
    for grid in (InputGrid(1e308, (0.0, 0.0, 0.0)), InputGrid(1e307, (1.7e308, 0.0, 0.0))):
        with pytest.raises(InputError, match="its grid"):
            input_coordinates(np.full((1, 3), 9.0), grid)
