"""Returns of recordings and virtual scans as one type, on disk and as points."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.returns import Beams, Returns, read_firings, write_firings
from pointkit.lidar.sensors import load_sensor
from puck.recordings.packet_turns import returns_of_packets
from tests.support.returns import EXAMPLES, dual, recorded
from tests.support.spinning import HDL32E, spin


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_file_brings_everything_back(name: str, tmp_path: Path) -> None:
    returns = EXAMPLES[name]()
    write_firings(tmp_path / "returns.parquet", returns)
    again = read_firings(tmp_path / "returns.parquet")
    assert replace(again, turns=()) == replace(returns, turns=())
    for first, other in zip(returns.turns, again.turns, strict=True):
        for field in ("ranges", "azimuths", "times", "reflectivities"):
            np.testing.assert_array_equal(getattr(first, field), getattr(other, field))
        assert first.ranges.dtype == other.ranges.dtype


def test_another_table_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    with pytest.raises(InputError, match="no such file"):
        read_firings(path)
    path.write_bytes(b"PAR1 nothing")
    with pytest.raises(InputError, match=r"not a table of firings \(Parquet\)"):
        read_firings(path)


def _put(name: str, row: Any, value: Any) -> Callable[[dict[str, Any]], None]:
    def put(columns: dict[str, Any]) -> None:
        values = columns[name].astype(np.result_type(columns[name], np.asarray(value)))
        values[row] = value
        columns[name] = values

    return put


def _reversed(columns: dict[str, Any]) -> None:
    for name, values in columns.items():
        columns[name] = values[::-1]


def _swapped(columns: dict[str, Any]) -> None:
    for name in ("laser_id", "distance"):
        columns[name][[3, 4]] = columns[name][[4, 3]]


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (_put("distance", 5, -3), "column distance has -3, not one of 0 to 65535$"),
        (_put("distance", 5, 70_000), "column distance has 70000, not one of 0 to 65535$"),
        (_put("distance", 5, 1 << 40), "column distance has 1099511627776, where integers of 32"),
        (_put("distance", 5, 0.5), "column distance has 0.5, where integers of 32 bits are"),
        (_put("distance", 5, np.nan), "column distance has nan, where integers of 32 bits are"),
        (_put("reflectivity", 5, 300), "column reflectivity has 300, not one of -1 to 255$"),
        (_put("reflectivity", 5, -7), "column reflectivity has -7, not one of -1 to 255$"),
        (_put("reflectivity", 5, -1), r"column reflectivity has -1 \(not known\) in a part"),
        (_put("azimuth", 0, 36_000), "column azimuth has 36000, not one of 0 to 35999$"),
        (_put("azimuth", 0, -1), "column azimuth has -1, not one of 0 to 35999$"),
        (_put("time", 0, 1 << 32), "column time has 4294967296, not one of -1 to 4294967295$"),
        (_put("azimuth", 70, 3), "turn 0: column azimuth has several values in a block or packet"),
        (_put("time", 700, 3), "turn 0: column time has several values in a block or packet"),
        (_put("time", slice(0, 768), -1), r"column time has -1 \(not known\) in a part of a turn$"),
        (_put("turn", 0, -1), "turns are not in order$"),
        (_put("laser_id", 3, 1 << 20), "column laser_id has 1048576, where integers of 16"),
        (_put("column", 0, 1), "turn 0: its rows are not in order: columns from 0, in each lasers"),
        (_put("return_kind", 0, 1), "turn 0: its rows are not in order"),
        (_swapped, "turn 0: its rows are not in order"),
        (_reversed, "not in order"),
    ],
)
def test_firings_that_no_turn_can_have_are_refused(
    change: Callable[[dict[str, Any]], None], fault: str, tmp_path: Path
) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    path = tmp_path / "returns.parquet"
    write_firings(path, dual())
    table = parquet.read_table(path)
    columns = {name: table.column(name).to_numpy().copy() for name in table.column_names}
    change(columns)
    changed = pa.table(columns).replace_schema_metadata(table.schema.metadata)
    parquet.write_table(changed, path)
    with pytest.raises(InputError, match=fault) as refusal:
        read_firings(path)
    assert str(refusal.value).startswith(f"{path}: ")


def test_a_repeated_second_return_counts_once() -> None:
    returns = dual()
    every = sum(int(np.count_nonzero(turn.ranges)) for turn in returns.turns)
    same = sum(
        int(np.count_nonzero((turn.ranges[0] == turn.ranges[1]) & (turn.ranges[0] > 0)))
        for turn in returns.turns
    )
    assert same > 0
    assert len(returns) == len(returns.points()) == every - same


def test_heights_and_delays_are_the_sensors() -> None:
    beams = Beams.of(load_sensor("vlp16"))
    assert beams.heights_mm[0] == 11.2
    assert beams.delays[1] == pytest.approx(2.304 / 55.296)
    virtual = Beams.of(load_sensor("vlp16"), "simultaneous", is_virtual=True)
    assert set(virtual.heights_mm) == set(virtual.delays) == {0.0}
    assert not virtual.clockwise


def test_seconds_are_those_of_the_packets() -> None:
    returns = recorded(150)
    assert returns.seconds == pytest.approx(150 * 1327.5e-6, rel=1e-3)
    bare = replace(returns.turns[0], times=None)
    assert replace(returns, turns=(bare,)).seconds is None


@pytest.mark.parametrize("order", ["as sent", "two swapped", "reversed"])
def test_seconds_do_not_depend_on_the_order_of_packets(order: str) -> None:
    """Ten packets of 1,327 microseconds pass the hour after seven."""
    places = np.arange(10)
    if order == "two swapped":
        places[[4, 5]] = places[[5, 4]]
    elif order == "reversed":
        places = places[::-1]
    result = returns_of_packets(spin(packets=10)[places])
    assert result.seconds == pytest.approx(10 * 1327e-6, abs=3e-6)


def test_a_clock_that_stands_still_tells_no_seconds() -> None:
    returns = recorded(20)
    still = tuple(replace(turn, times=np.zeros_like(turn.times)) for turn in returns.turns)
    assert replace(returns, turns=still).seconds is None


def test_turns_can_be_had_alone() -> None:
    returns = recorded()
    assert sum(len(turn) for turn in returns.split()) == len(returns)


def test_beams_must_be_as_many_as_lasers() -> None:
    returns = returns_of_packets(spin(HDL32E, packets=40))
    with pytest.raises(InputError, match="16 beams for 32 lasers"):
        Returns(Beams.of(load_sensor("vlp16")), returns.layout, returns.turns)
