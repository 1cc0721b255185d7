"""Turns of long packet captures, also compressed ones, read without the rest of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pointkit.errors import InputError, naming
from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import elapsed
from pointkit.lidar.unit_calibration import calibration_beside, calibration_in_packets
from puck.recordings.clock_leaps import packet_steps
from puck.recordings.data_packets import whole_packets
from puck.recordings.ouster import sensor_of
from puck.recordings.ouster_logs import ouster_log
from puck.recordings.ouster_packets import OusterKind
from puck.recordings.packet_order import is_regular, tell_irregularities
from puck.recordings.packet_turns import Payloads
from puck.recordings.packets import HDL64E, PACKET, PacketLog
from puck.recordings.pcap import read_datagrams
from puck.records import is_stream
from puck.turn_packets import TurnIndex
from puckbench.recordings.reading import RecordedTurns, turns_of_packets

_CALIBRATING_PACKETS, _TURNS_AT_ONCE = 10_000, 16
"""Number of packets in which the calibration of an HDL-64E, which has 4,160, is searched for."""
_LONG_BYTES, _COMPRESSED_TO = 1 << 26, 8
"""Size in bytes from which a recording is long, and a factor for compressed ones.

All of a shorter one is read, so that what is left out of it can be told.
"""


def is_long(path: Path) -> bool:
    """Return whether a recording is so large that it should not be read as a whole."""
    factor = _COMPRESSED_TO if is_stream(path) else 1
    return path.is_file() and path.stat().st_size * factor >= _LONG_BYTES


def count_whole_turns(index: TurnIndex) -> range | None:
    """Return the numbers of a recording's complete turns, or None if packets must tell them."""
    return None if isinstance(index.kind, OusterKind) else range(1, index.count - 1)


def read_some_turns(index: TurnIndex, first: int, last: int) -> RecordedTurns | None:
    """Read turns of a recording without the rest of it.

    Parameters
    ----------
    index
        The recording.
    first, last
        Numbers of the first and the last turn to read, from 0.

    Returns
    -------
    RecordedTurns or None
        The turns from `first` to `last` only; `whole` has numbers of the whole recording, and
        `begun_s` is the time at which turn `first` began. None if all of the recording must be
        read: it lacks one of the turns; packets are repeated, damaged or out of order; an Ouster's
        turn is not complete; or the first 10,000 packets of an HDL-64E lack its calibration.

    Raises
    ------
    InputError
        The file is damaged.
    """
    with naming(index.path):
        turns = index.packets(first, last + 1)
        if not 0 < len(turns) == last + 1 - first:
            return None
        log = _log(index, np.concatenate(turns))
        if log is None or not is_regular(log):
            return None
        calibrating = None
        if not isinstance(index.kind, OusterKind) and index.kind.product == HDL64E:
            calibrating = _calibrating(index)
            if calibrating is None:
                return None
        recorded = turns_of_packets(log, index.path, calibrating)
        if len(recorded.returns.turns) != len(turns):
            return None
        whole = count_whole_turns(index)
        if whole is None and len(recorded.whole) == len(turns):
            whole = range(first, last + 1)
        if not whole:
            return None
        tell_irregularities(index.path, log)
        begun_s = _begun_s(index, first, turns[0])
    return recorded._replace(whole=whole, begun_s=begun_s)


def _calibrating(index: TurnIndex) -> PacketLog | None:
    """Return the first packets of an HDL-64E if they, or a file beside it, have its calibration."""
    turns, count = list[Payloads](), 0
    for number in range(0, index.count, _TURNS_AT_ONCE):
        turns += index.packets(number, number + _TURNS_AT_ONCE)
        if (count := sum(map(len, turns))) >= _CALIBRATING_PACKETS:
            break
    payloads = np.concatenate(turns)
    is_known = calibration_beside(index.path) or calibration_in_packets(payloads[:, -2:])
    return PacketLog(payloads, np.zeros(count)) if is_known else None


def _begun_s(index: TurnIndex, number: int, packets: Payloads) -> float | None:
    """Return the time since 1970, in s, at which a turn of a capture began; None if it is unknown.

    It is the time at which the first packet of the capture was received, plus the time since then
    by the sensor's clock. `packets` are those of the turn with a `number`.
    """
    start, first = index.start(), index.packets(0, 1)[0][:1]
    datagrams = read_datagrams(start).datagrams if start else []
    payload = first[0].tobytes()
    received = next((each.received for each in datagrams if each.payload == payload), None)
    if received is None:
        return None
    if isinstance(index.kind, OusterKind):
        packet = sensor_of(index.metadata, "its metadata").packet
        steps_us = packet_steps(np.concatenate([first, packets[:1]]), packet).tolist()
        return float(received + steps_us[0] * 1e-6)
    since_us, *steps_us = packet_steps(np.concatenate([first, packets]), PACKET).tolist()
    if steps_us:  # the clock restarts hourly
        turn_us = sum(steps_us) * len(packets) / len(steps_us)
        since_us += HOUR_US * round((number * turn_us - since_us) / HOUR_US)
    return float(received + since_us * 1e-6)


def _log(index: TurnIndex, payloads: Payloads) -> PacketLog | None:
    if isinstance(index.kind, OusterKind):
        try:
            sensor = sensor_of(index.metadata, "its metadata")
            if sensor.packet.itemsize != payloads.shape[1]:
                return None
            return ouster_log(sensor, [row.tobytes() for row in payloads], None, {}, "its metadata")
        except InputError:  # whoever reads the whole recording tells
            return None
    clock_us = payloads.view(PACKET)["time_us"][:, 0].astype(np.float64)
    elapsed_s = elapsed(clock_us, HOUR_US) * 1e-6
    log = whole_packets([row.tobytes() for row in payloads], elapsed_s.tolist(), {})
    return None if log.about else log
