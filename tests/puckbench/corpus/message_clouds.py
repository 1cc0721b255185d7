"""Clouds of ROS as drivers publish them, after public reports on times, rings and intensities.

A case names the driver or the program in whose reports its kind is found; turns are generated, so
that true points and times are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pointkit.lidar.sensors import load_sensor
from tests.support.cloud_bags import Rows
from tests.support.cloud_turns import (
    BOOT_S,
    RANKS,
    SINCE_S,
    STAMP_S,
    TURN_S,
    Time,
    bag,
    points,
    seconds,
    turn,
    turns,
)
from tests.support.corpus_case import Case

COUNT = 3
VLP16 = load_sensor("vlp16")
STAMPS_S = np.repeat(TURN_S * np.arange(COUNT), len(SINCE_S))
STAMPED = [STAMP_S + TURN_S * number for number in range(COUNT)]
LEFT_OUT = r": its times are left out$"


def case(
    file: str,
    clouds: Sequence[Rows],
    stamps_s: Sequence[float] | None = None,
    frames: Sequence[str] = (),
    **more: Any,
) -> Case:
    """Make a case of a bag that is read with the VLP-16's lasers."""

    def write(path: Path) -> None:
        bag(path, clouds, stamps_s, frames)

    more = {"options": {"sensor": VLP16}, **more}
    return Case(file, write, "returns", None if "error" in more else points(clouds), **more)


def timed(file: str, name: str, kind: str, time: Time, **more: Any) -> Case:
    """Make a case of turns with this time field, by default with the true times."""
    clouds = turns(COUNT, name=name, kind=kind, time=time)
    return case(
        file, clouds, fields={"timestamp": seconds(COUNT), **more.pop("fields", {})}, **more
    )


def untimed(file: str, kind: str, time: Time, fault: str, name: str = "time") -> Case:
    """Make a case of turns whose time field is left out: points have the times of stamps."""
    clouds = turns(COUNT, name=name, kind=kind, time=time)
    warning = f"{file}: topic /points: field {name} {fault}{LEFT_OUT}"
    return case(file, clouds, warning=warning, fields={"timestamp": STAMPS_S})


def since_1970(ticks: float = 1.0, offset_s: float = 0.0) -> Time:
    return lambda since, begin: (STAMP_S + offset_s + begin + since) * ticks


def since_boot(ticks: float = 1.0, at_s: float = BOOT_S) -> Time:
    return lambda since, begin: (at_s + begin + since) * ticks


def scaled(ticks: float) -> Time:
    return lambda since, _: since * ticks


def wrapped(at_s: float) -> Time:
    """Nanoseconds since power-on in 32 bits, which begin again after 4.29 s."""
    return lambda since, begin: np.mod((at_s + begin + since) * 1e9, 1 << 32)


TIMES = [
    timed("velodyne_seconds.bag", "time", "<f4", scaled(1)),
    timed("velodyne_stamp_of_the_last_packet.bag", "time", "<f4", lambda since, _: since - TURN_S),
    timed("ouster_ns.mcap", "t", "<u4", scaled(1e9)),
    timed("livox_offset_ns.mcap", "offset_time", "<u4", scaled(1e9)),
    timed("lio_sam_us.bag", "time", "<f4", scaled(1e6)),
    timed("fast_lio_ms.bag", "time", "<f4", scaled(1e3)),
    timed("hesai_epoch.db3", "timestamp", "<f8", since_1970()),
    timed("hesai_local_time.db3", "timestamp", "<f8", since_1970(offset_s=8 * 3600.0)),
    timed("robosense_epoch.bag", "timestamp", "<f8", since_1970()),
    timed("robosense_no_gps.bag", "timestamp", "<f8", since_boot()),
    timed("robosense_just_started.bag", "timestamp", "<f8", since_boot(at_s=0.0)),
    timed("livox_boot_ns.mcap", "timestamp", "<f8", since_boot(1e9)),
    timed("hesai_week_of_gps.db3", "timestamp", "<f8", since_boot(at_s=345_600.0)),
    timed("boot_without_stamps.mcap", "timestamp", "<f8", since_boot(), stamps_s=[0.0] * COUNT),
    timed(
        "carla_shares.bag",
        "time",
        "<f4",
        scaled(1 / TURN_S),
        warning=r"has shares of a turn \(0 to 0\.984375\), taken as shares of 0\.125 s$",
    ),
    untimed(
        "hesai_epoch_as_f4.bag",
        "<f4",
        since_1970(),
        "has times of float32 in steps of 128 s",
    ),
    untimed(
        "livox_epoch_ns_as_f4.mcap",
        "<f4",
        since_1970(1e9),
        r"has times of float32 in steps of 137\.439 s",
    ),
    untimed(
        "azimuth_as_time.bag",
        "<f4",
        lambda since, _: 360 * since / TURN_S,
        r"has times of 0\.354375 s in a message, though messages are 0\.125 s apart",
    ),
    untimed("kiss_icp_zeros.mcap", "<f4", scaled(0), r"has one time for all points \(0\)"),
    untimed(
        "robosense_stamp_of_the_turn.db3",
        "<f8",
        lambda since, begin: STAMP_S + begin + 0 * since,
        r"has one time for all points \(1\.7e\+09\)",
    ),
    case(
        "ages_instead_of_times.bag",
        turns(COUNT, time=lambda since, _: TURN_S - since),
        warning="field time has times that fall from point to point$",
    ),
    case(
        "boot_ns_in_32_bits.mcap",
        turns(COUNT, name="t", kind="<u4", time=wrapped(4.25)),
        warning=r"/points: field t leaps by 4\.17\d+ s in message 0 \(1 of 3 leap\)$",
    ),
    case(
        "boot_ns_between_messages.mcap",
        turns(COUNT, name="t", kind="<u4", time=wrapped((1 << 32) / 1e9 - TURN_S)),
        warning=r"1 of 3 messages do not follow by their times in field t \(first -4\.16\d+ s to",
    ),
    case(
        "nan_times.bag",
        turns(COUNT, time=lambda since, _: np.where(since > 0.1, np.nan, since)),
        error="/points: field time has a value that is not finite$",
    ),
    case(
        "no_times.bag",
        turns(COUNT, time=None),
        fields={"timestamp": STAMPS_S},
    ),
]
STAMPS = [
    case(
        "stamps_of_zero.bag",
        turns(COUNT),
        [0.0] * COUNT,
        warning="2 of 3 messages do not follow by their stamps .first 0 s to message 1.$",
        fields={"timestamp": np.tile(SINCE_S, COUNT)},
    ),
    case(
        "stamps_that_repeat.mcap",
        [turn(0), turn(1), turn(2), turn(3)],
        [*STAMPED[:2], *STAMPED[1:]],
        warning="1 of 4 messages do not follow by their stamps .first 0 s to message 2, usually",
    ),
    case(
        "clock_set_back.bag",
        turns(COUNT),
        [*STAMPED[:2], STAMPED[2] - 7200],
        warning="1 of 3 messages do not follow by their stamps .first -7199.88 s to message 2, us",
    ),
    case(
        "lost_messages.mcap",
        [turn(number) for number in (0, 1, 2, 7)],
        [STAMP_S + TURN_S * number for number in (0, 1, 2, 7)],
        warning="1 of 4 messages leave gaps by their stamps .first 0.625 s to message 3, usually",
        fields={"timestamp": np.concatenate([TURN_S * n + SINCE_S for n in (0, 1, 2, 7)])},
    ),
    case(
        "gps_found.db3",
        [
            turn(number, "timestamp", "<f8", since_boot() if number < 2 else since_1970())
            for number in range(4)
        ],
        warning=r"1 of 4 messages leave gaps by their times in field timestamp \(first 1\.7e\+09 s",
    ),
    case(
        "two_frames.mcap",
        turns(COUNT),
        frames=["lidar_left", "lidar_right", "lidar_left"],
        error="message 1 is in frame 'lidar_right', message 0 in 'lidar_left': several sensors",
    ),
    case(
        "two_drivers.bag",
        [turn(0), turn(1, "timestamp", "<f8", since_1970())],
        error="message 1 and message 0 differ in the fields time, timestamp: several sensors in",
    ),
]


def ringed(file: str, ring: Any, kind: str = "<u2", **more: Any) -> Case:
    """Make a case of turns with these rings, whose lasers are fitted."""
    return case(file, turns(2, ring=ring, ring_kind=kind), **{"options": {}, **more})


def merged() -> Rows:
    """Two sensors a metre apart, with the same rings, in one cloud."""
    right = turn()
    right["y"] -= 1
    return np.concatenate([turn(), right])


RANKED = {"laser_id": np.tile(RANKS, 2)}
RINGS = [
    ringed("rings_from_1.bag", RANKS + 1, fields=RANKED),
    ringed("rings_from_the_highest.bag", 15 - RANKS, fields=RANKED),
    ringed("rings_in_f4.mcap", RANKS, "<f4", fields=RANKED),
    ringed(
        "rings_nan.mcap", np.where(SINCE_S > 0.1, np.nan, RANKS), "<f4", error="ring has a value"
    ),
    ringed(
        "rings_of_halves.mcap", RANKS / 2, "<f4", error="field ring has 0.5, no laser's number$"
    ),
    ringed(
        "numbers_as_rings.bag",
        np.arange(len(RANKS)),
        error="field ring has 1,024 numbers, more than 128 lasers$",
    ),
    ringed(
        "rings_of_dual_returns.db3",
        RANKS + 16 * (SINCE_S > 0.05),
        error="lasers 0 and 16 have the same elevation: -15$",
    ),
    ringed(
        "rings_of_zero.bag", 0 * RANKS, error="of laser 0 lie 8.0 degrees off its cone; this is"
    ),
    ringed("no_rings.bag", None, error="no laser column .laser_id, laser, label, ring, "),
    ringed(
        "rings_from_1_of_a_vlp16.bag",
        RANKS + 1,
        options={"sensor": VLP16},
        error="column ring has a value that is not a laser of the VLP-16: 16, not 0 to 15$",
    ),
    case(
        "merged_sensors.bag",
        [merged()],
        warning="column ring: 32% of the points lie more than 0.5 degrees off the cones of their",
    ),
]


def bright(file: str, intensity: Any, seen: str | None) -> Case:
    """Make a case of turns with these intensities."""
    fault = f"{file}: topic /points: column intensity has {seen}, which are no reflectivities from"
    values = np.broadcast_to(intensity if seen is None else -1, len(RANKS))
    return case(
        file,
        turns(2, intensity=intensity),
        fields={"reflectivity": np.tile(values, 2)},
        warning=None if seen is None else fault,
    )


INTENSITIES = [
    bright("intensities_of_bytes.bag", 17 * RANKS, None),
    bright("intensities_unknown.bag", -1, "-1 to -1"),
    bright("carla_intensities.mcap", RANKS / 15, "0 to 1"),
    bright("ouster_signal.mcap", 250 * RANKS, "0 to 3750"),
    bright("intensities_of_16_bits.bag", 4369 * RANKS, "0 to 65535"),
    bright("intensities_in_decibels.bag", RANKS - 8.5, r"-8\.5 to 6\.5"),
    bright("intensities_nan.db3", np.where(RANKS == 3, np.nan, RANKS), "0 to 15 and nan"),
]
CASES = [*TIMES, *STAMPS, *RINGS, *INTENSITIES]
