"""Turns of long packet captures, also compressed ones, read without the rest of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pointkit.errors import InputError, naming
from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import elapsed
from puck.recordings.data_packets import whole_packets
from puck.recordings.ouster import sensor_of
from puck.recordings.ouster_logs import ouster_log
from puck.recordings.ouster_packets import OusterKind
from puck.recordings.packet_order import is_regular, tell_irregularities
from puck.recordings.packet_turns import Payloads
from puck.recordings.packets import HDL64E, PACKET, PacketLog
from puck.records import is_stream
from puck.turn_packets import TurnIndex
from puckbench.recordings.reading import RecordedTurns, turns_of_packets

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
    if isinstance(index.kind, OusterKind) or index.kind.product == HDL64E:
        return None
    return range(1, index.count - 1)


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
        The turns from `first` to `last` only; `whole` has numbers of the whole recording, and the
        time at which it began is unknown. None if all of the recording must be read: it lacks one
        of the turns; packets are repeated, damaged or out of order; an Ouster's turn is not
        complete; or a calibration must be read from all packets (HDL-64E).

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
        recorded = turns_of_packets(log, index.path)
        if len(recorded.returns.turns) != len(turns):
            return None
        whole = count_whole_turns(index)
        if whole is None and len(recorded.whole) == len(turns):
            whole = range(first, last + 1)
        if not whole:
            return None
        tell_irregularities(index.path, log)
    return recorded._replace(whole=whole, begun_s=None)


def _log(index: TurnIndex, payloads: Payloads) -> PacketLog | None:
    if isinstance(index.kind, OusterKind):
        try:
            sensor = sensor_of(index.metadata, "its metadata")
            if sensor.packet.itemsize != payloads.shape[1]:
                return None
            return ouster_log(sensor, [row.tobytes() for row in payloads], None, {}, "its metadata")
        except InputError:  # whoever reads the whole recording tells
            return None
    if index.kind.product == HDL64E:
        return None
    clock_us = payloads.view(PACKET)["time_us"][:, 0].astype(np.float64)
    elapsed_s = elapsed(clock_us, HOUR_US) * 1e-6
    log = whole_packets([row.tobytes() for row in payloads], elapsed_s.tolist(), {})
    return None if log.about else log
