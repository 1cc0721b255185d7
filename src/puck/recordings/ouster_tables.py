"""Tables of the returns of an Ouster sensor, with the values that only such sensors report."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.lidar.return_table import FURTHER_COLUMNS, ReturnTable, return_table_of
from puck.recordings.ouster import PROFILES, OusterSensor, columns_of_turns, decoded_turns


def ouster_table(sensor: OusterSensor, payloads: NDArray[np.uint8]) -> ReturnTable:
    """Decode the packets of an Ouster sensor to a table with a row for each return.

    Parameters
    ----------
    sensor
        The sensor.
    payloads
        Packets (p, size in bytes), which may be in any order within a revolution.

    Returns
    -------
    ReturnTable
        The returns. Of the columns ``signal`` and ``near_infrared``, it has those that the sensor
        reports in this format of packets. The attribute ``about`` has the keys of
        `packet_turns.decode_packets`.

    Raises
    ------
    InputError
        No column of the packets contains data.
    """
    columns_of = columns_of_turns(sensor, payloads)
    returns, whole = decoded_turns(sensor, columns_of)
    if not returns.turns:
        raise InputError("no column with data in the recording")
    table = return_table_of(returns)
    profile = PROFILES[sensor.profile]
    parts: dict[str, list[NDArray[Any]]] = {}
    for columns, turn in zip(columns_of, returns.turns, strict=True):
        at, lasers, kinds = returns.indices(turn)
        parts.setdefault("column", []).append(columns["column"][at])
        parts.setdefault("clock_time", []).append(columns["time"][at])
        words = columns["pixels"]
        if profile.signals:
            signals = np.stack([field.of(words) for field in profile.signals])
            parts.setdefault("signal", []).append(signals[kinds, at, lasers])
        if (light := profile.light_of(words)) is not None:
            parts.setdefault("near_infrared", []).append(light[at, lasers])
    further = {
        name: np.concatenate(parts[name]).astype(kind)
        for name, (kind, *_) in FURTHER_COLUMNS.items()
        if name in parts
    }
    kinds_told = "dual" if sensor.layout.kinds == 2 else "strongest"
    about = {
        "returns": kinds_told,
        "packets": len(payloads),
        "whole_turns": [whole.start, whole.stop],
    }
    all_columns = {**table.columns, **further}
    return replace(table, columns=all_columns, about={**table.about, **about})
