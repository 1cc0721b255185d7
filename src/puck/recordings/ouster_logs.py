"""Logs of an Ouster's packets, and the comparison of packets with the sensor's metadata."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from puck.recordings.ouster import LEGACY, OusterSensor, frame_numbers, serials_of
from puck.recordings.packets import PacketLog, joined

_ENCODER_TICKS = 90112
"""Number of ticks of the azimuth encoder in a revolution, in packets of early firmware."""
_LEAST_SHARE = 0.7
"""Least share of a revolution's columns that fits into its time."""
_FEWEST_TURNS = 3
"""Least number of revolutions, of which one is whole, whose columns are compared."""


def ouster_log(
    sensor: OusterSensor,
    payloads: Sequence[bytes],
    received: Sequence[float] | None,
    about: dict[str, Any],
    described: str,
) -> PacketLog:
    """Return an Ouster's packets as a log, after a comparison with the sensor's metadata.

    Parameters
    ----------
    sensor
        The sensor's metadata.
    payloads
        Packets of the sensor's size.
    received
        Times of reception, in seconds since 1970. None: the times on the sensor's clock.
    about
        Facts about the recording, for `PacketLog.about`.
    described
        The metadata's file or topic and its content, for messages.

    Raises
    ------
    InputError
        The packets are of another sensor, or of another number of columns per revolution.
    """
    log = joined(payloads, received or [], about, sensor.packet.itemsize)
    packets = log.payloads.view(sensor.packet)[:, 0]
    if contradiction := find_contradiction(sensor, packets):
        raise InputError(f"{contradiction.seen}, and {described} is of {contradiction.stated}")
    if received is None:
        log = replace(log, received=packets["columns"]["time"][:, 0] * 1e-9)
    return replace(log, sensor=sensor)


class Contradiction(NamedTuple):
    """How packets contradict a sensor's metadata: what was seen, and what the metadata state."""

    seen: str
    stated: str


def find_contradiction(sensor: OusterSensor, packets: NDArray[Any]) -> Contradiction | None:
    """Return what shows that packets are not of the sensor that the metadata describe, or None.

    Parameters
    ----------
    sensor
        The sensor's metadata.
    packets
        Packets of the sensor's size, (p,), as records of the type `OusterSensor.packet`.
    """
    serials = serials_of(packets)
    if sensor.serial and serials and sensor.serial not in serials:
        return Contradiction(f"packets of the sensor {serials[0]}", f"{sensor.serial}")
    if fault := _wrong_columns(sensor, packets):
        return Contradiction(fault, f"{sensor.columns:,} columns per turn")
    return None


def unknown_facts(sensor: OusterSensor) -> list[str]:
    """Return what is not known of a sensor: whether packets are its own, and assumed offsets."""
    told = []
    if sensor.profile == LEGACY or not sensor.serial:
        where = "packets" if sensor.profile == LEGACY else "metadata"
        lacking = f"no serial number in the {where}"
        told.append(
            f"unverified whether the metadata ({sensor.name}) are of this sensor: {lacking}"
        )
    if sensor.assumed:
        told.append(f"offsets assumed as by the SDK: {' and '.join(sensor.assumed)}")
    return told


def _wrong_columns(sensor: OusterSensor, packets: NDArray[Any]) -> str | None:
    """Return what shows that revolutions have another number of columns, or None.

    Only packets of successive columns with data count.
    """
    numbers = packets["columns"]["column"].astype(np.int64)
    is_whole = (np.diff(numbers, axis=1) == 1).all(axis=1)
    is_whole &= (packets["columns"]["status"] & 1 == 1).all(axis=1)
    numbers, packets = numbers[is_whole], packets[is_whole]
    if not numbers.size:
        return None
    most = int(numbers.max()) + 1
    if most > sensor.columns:
        return f"packets of column {most - 1:,}"
    if sensor.profile == LEGACY and sensor.columns_per_packet > 1:
        steps = np.diff(packets["columns"]["encoder"].astype(np.int64), axis=1)
        ticks = float(np.median(steps))
        if ticks > 0 and round(_ENCODER_TICKS / ticks) != sensor.columns:
            return f"columns {ticks:g} of {_ENCODER_TICKS:,} encoder ticks apart"
    turns = len(np.unique(frame_numbers(packets)))
    if turns >= _FEWEST_TURNS and 2 * most <= sensor.columns < 2 * sensor.whole:
        return f"{turns} turns of columns below {most:,}"
    return _wrong_rotation(sensor, packets)


def _wrong_rotation(sensor: OusterSensor, packets: NDArray[Any]) -> str | None:
    """Return how many columns fit into the time of a revolution, if it is too short for all."""
    frames, first = np.unique(frame_numbers(packets), return_index=True)
    times = packets["columns"]["time"].astype(np.int64)
    if len(frames) < _FEWEST_TURNS or times.shape[1] < 2:
        return None
    column_ns = float(np.median(np.diff(times, axis=1)))
    begun = times[first, 0] - column_ns * packets["columns"]["column"][first, 0]
    turn_ns = float(np.median(np.diff(begun) / np.diff(frames)))
    if column_ns <= 0 or turn_ns <= 0:
        return None
    columns = turn_ns / column_ns
    is_short = columns < _LEAST_SHARE * sensor.columns
    return f"turns that take the time of {columns:,.0f} columns" if is_short else None
