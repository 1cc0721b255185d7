"""Logs of an Ouster's packets, and the comparison of packets with the sensor's metadata."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from puck.recordings.ouster import LEGACY, OusterSensor, frame_numbers, serial_of
from puck.recordings.packets import PacketLog, joined

_ENCODER_TICKS = 90112
"""Number of ticks of the azimuth encoder in a revolution, in packets of early firmware."""
_FEWEST_TURNS = 3
"""Least number of revolutions, of which one is whole, whose columns are compared."""

_log = logging.getLogger(__name__)


def ouster_log(
    sensor: OusterSensor,
    payloads: Sequence[bytes],
    received: Sequence[float] | None,
    about: dict[str, Any],
    source: Path,
    described: str,
) -> PacketLog:
    """Return an Ouster's packets as a log, after a comparison with the sensor's metadata.

    Warnings tell which offsets the metadata lack, and whether it is unknown if the packets are of
    this sensor.

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
    source
        File that warnings name.
    described
        The metadata's file or topic and its content, for messages.

    Raises
    ------
    InputError
        The packets are of another sensor, or of another number of columns per revolution.
    """
    log = joined(payloads, received or [], about, sensor.packet.itemsize)
    packets = log.payloads.view(sensor.packet)[:, 0]
    serials = Counter(serial_of(sensor, payload) for payload in payloads)
    if sensor.serial and not {None, sensor.serial} & serials.keys():
        other = serials.most_common(1)[0][0]
        raise InputError(f"packets of the sensor {other}, and {described} is of {sensor.serial}")
    if fault := _wrong_columns(sensor, packets):
        raise InputError(f"{fault}, and {described} is of {sensor.columns:,} columns per turn")
    if not sensor.serial or None in serials:
        where = "packets" if None in serials else "metadata"
        told = "unverified whether it is of this sensor, since a serial number is not in the"
        _log.warning("%s: %s: %s %s", source, described, told, where)
    if sensor.assumed:
        assumed = " and ".join(sensor.assumed)
        _log.warning("%s: %s lacks offsets; assumed as by the SDK: %s", source, described, assumed)
    if received is None:
        log = replace(log, received=packets["columns"]["time"][:, 0] * 1e-9)
    return replace(log, sensor=sensor)


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
    return None
