from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.return_table import ReturnTable
from tests.support.room_captures import NOISE, ROTATION_HZ, captured, room_scan
from tests.support.sensor_scenes import ROOM
from virtual_lidar.walls.stillness import still_rows, turn_shift

TURN_S = 1 / ROTATION_HZ


def drive(*stops: tuple[float, float]) -> ReturnTable:
    """Eight turns of a noisy sensor that is x metres from the middle at each time (in turns)."""
    path = tuple((turn * TURN_S, x, 0.0, 0.0, 0.0, 0.0, 0.0) for turn, x in stops)
    return captured(room_scan(8, path=path, noise=NOISE))


def turn(table: ReturnTable, number: int) -> ReturnTable:
    return table.select(table["turn"] == number)


@pytest.fixture(scope="module")
def standing() -> ReturnTable:
    return captured(room_scan(4, noise=NOISE))


def test_all_turns_of_a_standing_sensor_are_still(standing: ReturnTable) -> None:
    rows, still = still_rows(standing)
    assert len(rows) == len(standing)
    assert still.turns == len(np.unique(standing["turn"]))
    assert still.shift_m < 0.002


def test_the_interval_between_two_drives_is_found() -> None:
    table = drive((0, 0.0), (2, 0.1), (6, 0.1), (8, 0.3))
    rows, still = still_rows(table)
    # A turn of the virtual sensor ends where a turn of the packets does.
    assert (still.first, still.last) == (2, 5)
    assert set(rows["turn"]) == {2, 3, 4, 5}


def test_a_sensor_that_drives_on_is_refused() -> None:
    with pytest.raises(InputError, match=r"never stands still: from turn to turn .* 2\d\.\d mm"):
        still_rows(drive((0, 0.0), (8, 0.16)))


def test_a_slow_drift_ends_the_interval() -> None:
    _, still = still_rows(drive((0, 0.0), (8, 0.008)))
    assert 2 <= still.turns <= 4


def test_the_shift_towards_a_wall_is_that_of_the_sensor() -> None:
    here, there = (captured(room_scan(1, ROOM / 2 + [x, 0, 0])) for x in (0.0, 0.01))
    # Walls ahead and behind fill 0.44 of the turn; towards their corners rays meet them at an
    # angle of up to 50 degrees.
    assert 0.010 <= turn_shift(here, there) <= 0.0156
    assert turn_shift(here, here) == 0


def test_somebody_who_walks_past_does_not_end_the_interval(standing: ReturnTable) -> None:
    passing = (standing["turn"] == 2) & (standing["azimuth"] > 1.0) & (standing["azimuth"] < 2.0)
    distance = np.where(passing, 0.8, standing["distance"])
    walked = replace(standing, columns={**standing.columns, "distance": distance})
    assert still_rows(walked)[1].turns == still_rows(standing)[1].turns


def test_one_turn_does_not_tell(standing: ReturnTable) -> None:
    with pytest.raises(InputError, match="one turn does not show"):
        still_rows(turn(standing, 1))


def test_turns_that_see_nothing_together_are_refused(standing: ReturnTable) -> None:
    sides = (standing["turn"] % 2 == 0) == (standing["azimuth"] < np.pi)
    with pytest.raises(InputError, match="too few returns of two turns compare"):
        still_rows(standing.select(sides))


def turns(azimuths: Floats, distances: Floats, number: int = 0) -> ReturnTable:
    """One turn of one laser."""
    columns = {"azimuth": azimuths, "distance": distances}
    columns["laser_id"] = np.zeros(len(azimuths), dtype=int)
    columns["turn"] = np.full(len(azimuths), number)
    return ReturnTable(columns)


def sectors(shifts: Mapping[int, float], count: int = 30) -> ReturnTable:
    """So many returns in each of some sectors of ten degrees, all over it, 2 m away but for it."""
    within = (np.arange(count) + 0.5) * 10 / count
    degrees = np.concatenate([10 * sector + within for sector in shifts])
    return turns(np.radians(degrees), 2 + np.repeat(list(shifts.values()), count))


def around(step_deg: float = 0.3, rise_m: float = 0.0) -> ReturnTable:
    """A turn of 2 m, of which every other return is farther by some."""
    azimuths = np.radians(np.arange(0, 360, step_deg))
    return turns(azimuths, 2 + rise_m * (np.arange(len(azimuths)) % 2))


def test_the_shift_is_the_third_quartile_of_the_sectors_medians() -> None:
    shifts = {0: 0.001, 1: -0.002, 2: 0.003, 34: 0.004}
    assert turn_shift(around(), sectors(shifts)) == pytest.approx(0.00325)


@pytest.mark.parametrize(
    ("number", "count", "compares"), [(3, 30, True), (3, 29, False), (2, 30, False)]
)
def test_three_sectors_of_thirty_returns_compare(number: int, count: int, compares: bool) -> None:
    other = sectors(dict.fromkeys(range(number), 0.001), count)
    assert np.isfinite(turn_shift(around(), other)) == compares


@pytest.mark.parametrize(
    ("step_deg", "rise_m", "compares"),
    [(0.88, 0.0, True), (0.92, 0.0, False), (0.3, 0.098, True), (0.3, 0.102, False)],
)
def test_distances_are_interpolated_on_one_surface(
    step_deg: float, rise_m: float, compares: bool
) -> None:
    result = turn_shift(around(step_deg, rise_m), sectors(dict.fromkeys(range(8), 0.0)))
    assert np.isfinite(result) == compares


def standing_at(*distances: float) -> ReturnTable:
    parts = [
        turns(around()["azimuth"], around()["distance"] + d, i) for i, d in enumerate(distances)
    ]
    return ReturnTable(
        {name: np.concatenate([part[name] for part in parts]) for name in parts[0].columns}
    )


@pytest.mark.parametrize(
    ("distances", "first", "last", "shift"),
    [
        ((0, 0.0029), 0, 1, 0.0029),
        ((0, 0.002, -0.001), 0, 2, 0.002),
        ((0, 0, 1, 1), 0, 1, 0),
        ((0, 0, 1, 1, 1), 2, 4, 0),
        ((0, 0.002, 0.004, 0.006), 0, 1, 0.002),
    ],
)
def test_the_longest_interval_that_repeats_its_first_turn(
    distances: tuple[float, ...], first: int, last: int, shift: float
) -> None:
    rows, still = still_rows(standing_at(*distances))
    assert (still.first, still.last) == (first, last)
    assert still.shift_m == pytest.approx(shift)
    assert np.unique(rows["turn"]).tolist() == list(range(first, last + 1))


def test_three_millimetres_are_the_limit() -> None:
    with pytest.raises(InputError, match=r"change by 3\.3 mm or more \(limit 3 mm\)"):
        still_rows(standing_at(0, 0.0033, 0.0066))
