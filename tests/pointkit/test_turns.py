"""Images of turns at the limits of their layouts, and steps of clocks that start again."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.turns import (
    MAX_COLUMNS,
    MAX_PIXELS,
    MAX_RANGE,
    Layout,
    Turn,
    by_elevation,
    by_laser,
    check_turn,
    clock_steps,
    has_wide_ranges,
)

PUCK = Layout((0, 2, 1), columns_per_block=2, blocks_per_time=3, kinds=2)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"order": ()}, "no permutation"),
        ({"order": (0, 2)}, "no permutation"),
        ({"order": (1, 2)}, "no permutation"),
        ({"order": tuple(range(129))}, "at most 128 lasers and two kinds"),
        ({"kinds": 0}, "at most 128 lasers and two kinds"),
        ({"kinds": 3}, "at most 128 lasers and two kinds"),
        ({"columns_per_block": 0}, "are 1 to 255"),
        ({"columns_per_block": 256}, "are 1 to 255"),
        ({"blocks_per_time": 0}, "are 1 to 255"),
        ({"blocks_per_time": 256}, "are 1 to 255"),
        ({"azimuth_steps": 0}, "are 1 to 65536"),
        ({"azimuth_steps": 65537}, "are 1 to 65536"),
        ({"shifts": (1, 2)}, "less than 16384 columns"),
        ({"shifts": (1, 2, -16384)}, "less than 16384 columns"),
    ],
)
def test_layouts_have_limits(changes: dict[str, Any], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        replace(PUCK, **changes)


def test_layouts_reach_their_limits() -> None:
    widest = Layout(tuple(range(128)), columns_per_block=255, blocks_per_time=255, kinds=2)
    assert widest.lasers == 128
    # 2^20 pixels of 128 lasers are 8,192 columns.
    assert widest.max_blocks == 32
    assert vars(Layout((0,))) == {
        "order": (0,), "columns_per_block": 1, "blocks_per_time": 1, "kinds": 1,
        "azimuth_steps": 36000, "shifts": (),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("lasers", "columns", "blocks"),
    [(16, 2, 8192), (64, 1, 16384), (65, 1, 16131), (128, 1, 8192), (1, 3, 5461)],
)
def test_a_turn_has_at_most_16384_columns_and_1048576_pixels(
    lasers: int, columns: int, blocks: int
) -> None:
    assert Layout(tuple(range(lasers)), columns).max_blocks == blocks
    assert blocks * columns <= MAX_COLUMNS
    assert blocks * columns * lasers <= MAX_PIXELS


def image(blocks: int, layout: Layout = PUCK) -> Turn:
    """A turn without a return, of so many blocks."""
    shape = (layout.kinds, blocks * layout.columns_per_block, layout.lasers)
    times = np.zeros(-(-blocks // layout.blocks_per_time), np.uint32)
    azimuths = np.zeros(blocks, np.uint16)
    return Turn(np.zeros(shape, np.uint16), azimuths, times, np.zeros(shape, np.uint8))


def test_a_turn_has_the_shapes_of_its_layout() -> None:
    """Seven blocks of two columns; three blocks share a time, and the last has its own."""
    turn = image(7)
    assert turn.ranges.shape == (2, 14, 3)
    assert turn.times is not None
    assert turn.times.shape == (3,)
    check_turn(turn, PUCK)
    check_turn(replace(turn, times=None, reflectivities=None), PUCK)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ranges", np.zeros((2, 14, 3), np.int32)),
        ("ranges", np.zeros((1, 14, 3), np.uint16)),
        ("ranges", np.zeros((2, 13, 3), np.uint16)),
        ("ranges", np.zeros((2, 14, 4), np.uint16)),
        ("azimuths", np.zeros(7, np.int64)),
        ("azimuths", np.zeros((7, 1), np.uint16)),
        ("times", np.zeros(3, np.int64)),
        ("times", np.zeros(2, np.uint32)),
        ("reflectivities", np.zeros((2, 14, 3), np.int16)),
        ("reflectivities", np.zeros((2, 14, 2), np.uint8)),
    ],
)
def test_another_shape_or_type_is_refused_by_its_name(name: str, value: Any) -> None:
    changes: dict[str, Any] = {name: value}
    with pytest.raises(InputError, match=f"^{name} of a turn are "):
        check_turn(replace(image(7), **changes), PUCK)


def test_a_turn_has_one_block_or_more_and_no_more_than_the_layout_allows() -> None:
    layout = Layout(tuple(range(128)), columns_per_block=255)
    check_turn(image(1, layout), layout)
    check_turn(image(32, layout), layout)
    for blocks in (0, 33):
        with pytest.raises(InputError, match=rf"a turn of {blocks} blocks \(1 to 32\)"):
            check_turn(image(blocks, layout), layout)


def test_ranges_have_16_bits_or_up_to_24_of_32() -> None:
    turn = image(7)
    wide = replace(turn, ranges=turn.ranges.astype(np.uint32))
    assert (has_wide_ranges(turn), has_wide_ranges(wide)) == (False, True)
    wide.ranges[1, 2, 0] = MAX_RANGE
    check_turn(wide, PUCK)
    wide.ranges[1, 2, 0] += 1
    with pytest.raises(InputError, match="exceed 16777215 quanta"):
        check_turn(wide, PUCK)


def test_shifts_bring_the_lasers_of_one_direction_into_one_column() -> None:
    """As Ouster's destaggering: row by row, np.roll by the shift of the laser."""
    layout = replace(PUCK, shifts=(2, -1, 0))
    values = np.arange(2 * 14 * 3).reshape(2, 14, 3)
    shifted = by_elevation(values, layout)
    for place, laser in enumerate(layout.order):
        rolled = np.roll(values[:, :, laser], layout.shifts[laser], axis=1)
        assert np.array_equal(shifted[:, :, place], rolled)
    assert np.array_equal(by_laser(shifted, layout), values)
    assert np.array_equal(by_laser(by_elevation(values, PUCK), PUCK), values)


def test_returns_are_counted_of_the_first_kind() -> None:
    turn = image(7)
    turn.ranges[0, :5, 1] = 1
    turn.ranges[1] = 9
    assert turn.returns == 5


def test_the_clock_takes_the_nearest_way_over_the_hour() -> None:
    """Of all whole hours that may have passed, the one that makes the step smallest."""
    times = np.array([3599.0, 1.0, 3598.0, 3598.5, 1798.0, 3597.5, 0.0])
    passed = np.diff(times)[:, None] + 3600 * np.arange(-2, 3)
    nearest = np.take_along_axis(passed, np.abs(passed).argmin(axis=1)[:, None], axis=1)[:, 0]
    assert nearest[:2].tolist() == [2, -3]
    assert clock_steps(times, 3600.0).tolist() == nearest.tolist()
