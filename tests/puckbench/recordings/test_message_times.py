"""Times of points in clouds of ROS: each kind is read right, or left out in one line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.return_table import ReturnTable
from pointkit.lidar.sensors import load_sensor
from puckbench.recordings.message_returns import read_message_columns
from puckbench.recordings.reading import read_recording
from tests.support.cloud_bags import Rows
from tests.support.cloud_turns import (
    BOOT_S,
    RANKS,
    SINCE_S,
    STAMP_S,
    TURN_S,
    Time,
    bag,
    seconds,
    turn,
    turns,
)

COUNT = 4
TRUE_S = seconds(COUNT)
STAMPS_S = np.repeat(TURN_S * np.arange(COUNT), len(SINCE_S))


def read(path: Path, clouds: Sequence[Rows], stamps_s: Any = None, **options: Any) -> ReturnTable:
    return read_recording(bag(path, clouds, stamps_s), load_sensor("vlp16"), **options)


RIGHT: dict[str, tuple[str, str, Time]] = {
    "s": ("time", "<f4", lambda since, _: since),
    "ms": ("time", "<f4", lambda since, _: since * 1e3),
    "us": ("time", "<f4", lambda since, _: since * 1e6),
    "ns_u4": ("t", "<u4", lambda since, _: since * 1e9),
    "ns_f8": ("time", "<f8", lambda since, _: since * 1e9),
    "before_the_stamp": ("time", "<f4", lambda since, _: since - TURN_S),
    "before_the_stamp_ns": ("offset_time", "<i4", lambda since, _: (since - TURN_S) * 1e9),
    "epoch_f8": ("timestamp", "<f8", lambda since, begin: STAMP_S + begin + since),
    "epoch_ns_f8": ("timestamp", "<f8", lambda since, begin: (STAMP_S + begin + since) * 1e9),
    "epoch_us_f8": ("timestamp", "<f8", lambda since, begin: (STAMP_S + begin + since) * 1e6),
    "other_time_zone": ("timestamp", "<f8", lambda since, begin: STAMP_S + 7200 + begin + since),
    "boot_f8": ("timestamp", "<f8", lambda since, begin: BOOT_S + begin + since),
    "boot_ns_f8": ("timestamp", "<f8", lambda since, begin: (BOOT_S + begin + since) * 1e9),
    "just_booted": ("timestamp", "<f8", lambda since, begin: begin + since),
    "gps_week": ("timestamp", "<f8", lambda since, begin: 432_000 + begin + since),
}


@pytest.mark.parametrize("kind", RIGHT)
@pytest.mark.parametrize("messages", [1, COUNT])
def test_times_of_any_origin_and_unit_are_read_right(
    kind: str, messages: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    name, form, time = RIGHT[kind]
    clouds = turns(messages, name=name, kind=form, time=time)
    result = read(tmp_path / "a.mcap", clouds)["timestamp"]
    assert result == pytest.approx(TRUE_S[: len(result)], abs=2e-6)
    assert not caplog.messages


def test_integers_of_64_bits_since_1970_keep_every_microsecond(tmp_path: Path) -> None:
    """PointCloud2 has no such type; times are differences before they are floats."""
    from puckbench.recordings.message_times import MessagePoints, seconds_of_messages

    parts = []
    for number in range(COUNT):
        rows = turn(number)
        since = np.rint((TURN_S * number + SINCE_S) * 1e9).astype(np.uint64)
        columns = {
            **{axis: rows[axis] for axis in "xyz"},
            "t": since + np.uint64(1_700_000_000 * 10**9),
        }
        parts.append(MessagePoints(number, 0, "", columns))
    parts_s, are_timed = seconds_of_messages(parts, None, "a")
    assert are_timed
    assert np.concatenate(parts_s) == pytest.approx(TRUE_S, abs=1e-9)


LEFT_OUT: dict[str, tuple[str, Time, str]] = {
    "epoch_f4": (
        "<f4",
        lambda since, begin: STAMP_S + begin + since,
        "field time has times of float32 in steps of 128 s",
    ),
    "epoch_ns_f4": (
        "<f4",
        lambda since, begin: (STAMP_S + begin + since) * 1e9,
        "field time has times of float32 in steps of 137.439 s",
    ),
    "long_booted_f4": (
        "<f4",
        lambda since, begin: 40_000 + begin + since,
        "field time has times of float32 in steps of 0.00390625 s",
    ),
    "degrees": (
        "<f4",
        lambda since, _: 360 * since / TURN_S,
        "field time has times of 0.354375 s in a message, though messages are 0.125 s apart",
    ),
    "zeros": ("<f4", lambda since, _: 0 * since, r"field time has one time for all points \(0\)"),
    "stamp": (
        "<f8",
        lambda since, begin: STAMP_S + begin + 0 * since,
        r"field time has one time for all points \(1.7e\+09\)",
    ),
}


@pytest.mark.parametrize("kind", LEFT_OUT)
def test_values_that_are_no_times_of_firings_are_left_out_in_one_line(
    kind: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    form, time, fault = LEFT_OUT[kind]
    table = read(tmp_path / "a.db3", turns(COUNT, kind=form, time=time))
    assert table["timestamp"] == pytest.approx(STAMPS_S, abs=1e-6)
    (line,) = caplog.messages
    assert line.startswith(f"{tmp_path / 'a.db3'}: topic /points: field time ")
    assert re.search(fault + ": its times are left out$", line), line


@pytest.mark.parametrize("offset_deg", [0, 4])
def test_shares_of_a_turn_are_multiplied_by_the_time_between_messages(
    offset_deg: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Also if each laser fires at an azimuth and a time of its own."""
    clouds = turns(COUNT, time=lambda since, _: (since + RANKS * 1e-5) / TURN_S)
    for rows in clouds:
        ahead = np.radians(offset_deg * (RANKS % 2))
        x, y = rows["x"].copy(), rows["y"].copy()
        rows["x"] = x * np.cos(ahead) + y * np.sin(ahead)
        rows["y"] = y * np.cos(ahead) - x * np.sin(ahead)
    table = read(tmp_path / "a.mcap", clouds)
    expected = TRUE_S + np.tile(RANKS, COUNT) * 1e-5
    assert table["timestamp"] == pytest.approx(expected, abs=2e-6)
    (line,) = caplog.messages
    assert re.search(
        r"field time has shares of a turn \(0 to 0\.98.*\), taken as shares of 0\.125 s", line
    )
    for number in (0, 2, COUNT - 1):
        part = read_message_columns(tmp_path / "a.mcap", None, (number, number))["time"]
        assert part == pytest.approx(SINCE_S + RANKS * 1e-5, abs=2e-6)


def test_shares_of_a_turn_that_stands_alone_are_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    table = read(tmp_path / "a.db3", turns(1, time=lambda since, _: since / TURN_S))
    assert not table["timestamp"].any()
    (line,) = caplog.messages
    assert line.endswith(
        "shares of a turn (0 to 0.984375), which are no times: its times are left out"
    )


def test_a_named_unit_is_taken_at_its_word(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    clouds = turns(1, time=lambda since, _: since / TURN_S)
    result = read(tmp_path / "a.mcap", clouds, time_unit="s")["timestamp"]
    assert result == pytest.approx(SINCE_S / TURN_S, abs=1e-6)
    assert not caplog.messages


def test_a_named_unit_does_not_make_coarse_or_constant_numbers_times(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for kind in ("epoch_f4", "zeros"):
        form, time, fault = LEFT_OUT[kind]
        caplog.clear()
        table = read(tmp_path / f"{kind}.bag", turns(COUNT, kind=form, time=time), time_unit="s")
        assert table["timestamp"] == pytest.approx(STAMPS_S, abs=1e-6)
        (line,) = caplog.messages
        assert re.search(fault + ": its times are left out$", line), line


def test_the_distance_of_stamps_tells_a_unit_that_no_rotation_tells(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A sensor that does not spin (Livox) gives floats in ns or ms."""
    since = np.random.default_rng(1).permutation(len(SINCE_S)) / len(SINCE_S) * TURN_S
    for ticks in (1.0, 1e3, 1e6, 1e9):
        clouds = turns(COUNT, time=lambda _, __, ticks=ticks: since * ticks)
        result = read(tmp_path / f"{ticks:g}.mcap", clouds)["timestamp"]
        true = np.concatenate([TURN_S * number + since for number in range(COUNT)])
        assert result == pytest.approx(true, abs=1e-6)
    assert not caplog.messages
    lone = turns(1, kind="<f8", time=lambda _, __: since * 1e9)
    with pytest.raises(InputError, match=r"the unit of field time cannot be inferred: add --time-"):
        read(tmp_path / "b.mcap", lone)


def test_times_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    clouds = turns(2)
    clouds[1]["time"][7] = np.nan
    with pytest.raises(InputError, match="/points: field time has a value that is not finite"):
        read(tmp_path / "a.mcap", clouds)


def _delayed(values: Sequence[float]) -> list[float]:
    return [STAMP_S + value for value in values]


ORDERS: dict[str, tuple[list[float], str]] = {
    "zero": ([0.0] * 4, "3 of 4 messages do not follow by their stamps (first 0 s to message 1)"),
    "repeated": (
        _delayed([0, 0.1, 0.1, 0.2]),
        "1 of 4 messages do not follow by their stamps (first 0 s to message 2, usually 0.1 s)",
    ),
    "back": (
        _delayed([0, 0.1, -3600, -3599.9]),
        "1 of 4 messages do not follow by their stamps (first -3600.1 s to message 2, usually",
    ),
    "lost": (
        _delayed([0, 0.1, 0.4, 0.5]),
        "1 of 4 messages leave gaps by their stamps (first 0.3 s to message 2, usually 0.1 s)",
    ),
    "leap": (
        [100.0, 100.1, *_delayed([0, 0.1])],
        "1 of 4 messages leave gaps by their stamps (first 1.7e+09 s to message 2, usually 0.1 s)",
    ),
}


@pytest.mark.parametrize("kind", ORDERS)
def test_messages_out_of_order_lost_or_of_a_clock_that_leaps_are_told(
    kind: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stamps, line = ORDERS[kind]
    read(tmp_path / "a.bag", turns(4), stamps)
    (told,) = caplog.messages
    assert told.startswith(f"{tmp_path / 'a.bag'}: topic /points: {line}")


@pytest.mark.parametrize("absolute", [False, True])
def test_a_message_without_a_point_is_no_gap(
    absolute: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    time = (lambda since, begin: BOOT_S + begin + since) if absolute else None
    clouds = turns(5, kind="<f8", **({"time": time} if time else {}))
    clouds[2] = clouds[2][:0]
    read(tmp_path / "a.bag", clouds)
    (line,) = caplog.messages
    assert line.endswith("/points: left out 1 message without a point")


def test_stamps_do_not_matter_where_points_have_absolute_times(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    clouds = turns(COUNT, kind="<f8", time=lambda since, begin: BOOT_S + begin + since)
    result = read(tmp_path / "a.mcap", clouds, [0.0] * COUNT)["timestamp"]
    assert result == pytest.approx(TRUE_S, abs=1e-6)
    assert not caplog.messages


def test_a_clock_of_points_that_leaps_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """GPS found: the clock goes from the time since power-on to that of the day."""

    def locked(since: Any, begin: float) -> Any:
        return (BOOT_S if begin < 0.15 else 50_000) + begin + since

    read(tmp_path / "a.mcap", turns(4, kind="<f8", time=locked))
    (line,) = caplog.messages
    assert line.endswith(
        "1 of 4 messages leave gaps by their times in field time (first 45000.1 s to message 2, "
        "usually 0.125 s)"
    )


def test_times_that_fall_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    clouds = turns(COUNT, time=lambda since, _: TURN_S - since)
    read(tmp_path / "a.mcap", clouds)
    (line,) = caplog.messages
    assert line.endswith("/points: field time has times that fall from point to point")


def test_points_ring_by_ring_do_not_fall(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    by_ring = [cloud[np.argsort(cloud["ring"], kind="stable")] for cloud in turns(2)]
    read(tmp_path / "a.mcap", by_ring)
    assert not caplog.messages


def test_several_sensors_in_one_topic_are_refused(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap", turns(3), frames=["left", "left", "right"])
    fault = r"message 2 is in frame 'right', message 0 in 'left': several sensors in one topic\?"
    with pytest.raises(InputError, match=fault):
        read_recording(path)
    clouds = [turn(0), turn(1, name="t", kind="<u4", time=lambda since, _: since * 1e9)]
    fault = r"message 1 and message 0 differ in the fields t, time: several sensors"
    with pytest.raises(InputError, match=fault):
        read(tmp_path / "b.mcap", clouds)


def test_frames_with_and_without_a_slash_are_the_same(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap", turns(2), frames=["/lidar", "lidar"])
    assert len(read_recording(path)) == 2 * len(SINCE_S)
