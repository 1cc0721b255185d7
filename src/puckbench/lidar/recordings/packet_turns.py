"""Conversion between data packets of Velodyne sensors and turns (range images of revolutions).

VLP-16, Puck Hi-Res, HDL-32E and VLP-32C have the same format (VLP-16 User Manual
63-9243 Rev. E, chapter 9; HDL-32E User Manual 63-9113 Rev. M, appendix C; VLP-32C User Manual
63-9325).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.lidar.recordings.packets import (
    BLOCK,
    BLOCKS,
    DUAL_MODE,
    FLAG,
    MODES,
    PACKET,
    PACKET_BYTES,
    PRODUCTS,
)
from puckbench.lidar.recordings.returns import LAST, RecordedReturns, table_of_returns
from puckbench.lidar.returns import USUAL_QUANTUM_M, Beams, Returns
from puckbench.lidar.sensor import Sensor, load_sensor
from puckbench.lidar.turns import CENTIDEGREES, Layout, Turn

SENSORS = {0x21: "hdl32e", 0x22: "vlp16", 0x24: "puck_hires", 0x28: "vlp32c"}
"""Names of sensors by the product byte of their packets."""
_CHANNELS = 32
_BLOCK_BYTES = BLOCK.itemsize

Payloads = NDArray[np.uint8]


@dataclass(frozen=True)
class PacketKind:
    """Product and return mode (last two bytes) of packets, and the layout of their images."""

    product: int
    mode: int
    layout: Layout

    def returns(self, turns: Iterable[Turn], sensor: Sensor | None = None) -> Returns:
        sensor = sensor or load_sensor(SENSORS[self.product])
        if sensor.lasers != self.layout.lasers or sensor.firing_sequence_us is None:
            lasers = f"{self.layout.lasers} lasers and their firing times"
            raise InputError(f"sensor {sensor.name} is not described with {lasers}")
        quantum = (sensor.range_quantum_mm or 0.0) / 1000 or USUAL_QUANTUM_M
        return Returns(Beams.of(sensor), self.layout, tuple(turns), quantum, sensor.name)


@cache
def packet_kind(product: int, mode: int) -> PacketKind:
    if product not in SENSORS:
        name = PRODUCTS.get(product, "an unknown sensor")
        raise InputError(
            f"packets of {name} (product 0x{product:02X}), not of a VLP-16, a Puck Hi-Res, an "
            "HDL-32E or a VLP-32C"
        )
    if mode not in MODES:
        raise InputError(f"return mode 0x{mode:02X}, where one of 0x37, 0x38, 0x39 is expected")
    sensor = load_sensor(SENSORS[product])
    order = tuple(int(laser) for laser in np.argsort(sensor.laser_elevation_deg, kind="stable"))
    kinds = 2 if mode == DUAL_MODE else 1
    ahead = np.array(sensor.laser_azimuth_deg or ()) / sensor.azimuth_step_deg
    shifts = tuple(np.rint(ahead).astype(int).tolist())
    blocks, columns = BLOCKS // kinds, _CHANNELS // sensor.lasers
    return PacketKind(product, mode, Layout(order, columns, blocks, kinds, shifts=shifts))


def find_packets(data: Payloads) -> NDArray[np.int64]:
    """Return the ascending positions of the data packets of `SENSORS` in bytes."""
    last = len(data) - PACKET_BYTES + 1
    if last < 1:
        return np.zeros(0, np.int64)
    low, high = FLAG & 255, FLAG >> 8
    places = np.flatnonzero((data[:last] == low) & (data[1 : last + 1] == high))
    for block in range(1, BLOCKS):
        at = places + block * _BLOCK_BYTES
        places = places[(data[at] == low) & (data[at + 1] == high)]
    has_known_product = np.isin(data[places + PACKET_BYTES - 1], list(SENSORS))
    has_known_product &= np.isin(data[places + PACKET_BYTES - 2], list(MODES))
    places = places[has_known_product]
    for byte in (2, 3):  # both blocks of a pair have the same azimuth
        at = places[:, None] + np.arange(BLOCKS // 2) * 2 * _BLOCK_BYTES + byte
        is_equal = (data[at] == data[at + _BLOCK_BYTES]).all(axis=1)
        places = places[is_equal | (data[places + PACKET_BYTES - 2] != DUAL_MODE)]
    return without_overlaps(places)


def without_overlaps(places: NDArray[np.int64], size: int = PACKET_BYTES) -> NDArray[np.int64]:
    """Return the ascending places of packets of `size` bytes that overlap no earlier packet."""
    if (np.diff(places) >= size).all():
        return places
    kept: list[int] = []
    for place in places.tolist():
        if not kept or place >= kept[-1] + size:
            kept.append(place)
    return np.array(kept, np.int64)


def split_turns(payloads: Payloads) -> Iterator[tuple[PacketKind, Payloads]]:
    """Split packets (p, 1206) into revolutions; each begins with the packet that passes azimuth 0.

    Parts also end where sensor or return mode change, or at a `Layout`'s most blocks.
    """
    packets = _viewed(payloads)
    azimuths = packets["blocks"]["azimuth"].astype(np.int64)
    before = np.concatenate([azimuths[:1, 0], azimuths[:-1, -1]])
    falls = np.diff(azimuths, axis=1, prepend=before[:, None]) < -CENTIDEGREES // 2
    ends = payloads[:, -2:].astype(np.int64) @ [256, 1]
    starts = falls.any(axis=1) | (np.diff(ends, prepend=ends[:1]) != 0)
    starts[:1] = True
    edges = [*np.flatnonzero(starts).tolist(), len(payloads)]
    for first, end in pairwise(edges):
        kind = packet_kind(int(payloads[first, -1]), int(payloads[first, -2]))
        most = kind.layout.max_blocks // kind.layout.blocks_per_time
        for start in range(first, end, most):
            yield kind, payloads[start : min(start + most, end)]


def turn_of(kind: PacketKind, payloads: Payloads) -> Turn:
    """Convert packets (p, 1206) to a turn; of two returns of a beam, the strongest comes first."""
    packets = _viewed(payloads)
    blocks = packets["blocks"]
    return Turn(
        _imaged(kind, blocks["returns"]["distance"]),
        np.ascontiguousarray(blocks["azimuth"][:, :: kind.layout.kinds].ravel()),
        packets["time_us"].astype(np.uint32),
        _imaged(kind, blocks["returns"]["reflectivity"]),
    )


def is_whole(payloads: Payloads) -> NDArray[np.bool_]:
    """Return which packets (p, 1206) have valid flags and azimuths, equal in both dual returns."""
    packets = _viewed(payloads)
    flags, azimuth = packets["blocks"]["flag"], packets["blocks"]["azimuth"]
    is_valid = (flags == FLAG).all(axis=1) & (azimuth < CENTIDEGREES).all(axis=1)
    paired = (azimuth[:, ::2] == azimuth[:, 1::2]).all(axis=1)
    is_valid &= paired | (packets["mode"] != DUAL_MODE)
    return np.asarray(is_valid, dtype=np.bool_)


def returns_of_packets(payloads: Payloads, sensor: Sensor | None = None) -> Returns:
    """Decode packets (p, 1206) to returns; the first and the last revolution may be incomplete.

    The default sensor is that of the packets' product code. Raises InputError for damaged packets,
    or several sensors or return modes.
    """
    if len(payloads) == 0:
        raise InputError("no data packets")
    whole = is_whole(payloads)
    if not whole.all():
        raise InputError(f"packet {int(np.argmin(whole))} is damaged")
    parts = list(split_turns(payloads))
    kinds = dict.fromkeys(f"{PRODUCTS[kind.product]} {MODES[kind.mode]}" for kind, _ in parts)
    if len(kinds) > 1:
        raise InputError(f"packets of more than one sensor or return mode ({', '.join(kinds)})")
    return parts[0][0].returns((turn_of(kind, part) for kind, part in parts), sensor)


def decode_packets(payloads: Payloads, sensor: Sensor | None = None) -> RecordedReturns:
    """Decode packets (p, 1206) to a table; see `returns_of_packets`. A turn begins at azimuth 0."""
    returns = returns_of_packets(payloads, sensor)
    device = sensor or load_sensor(SENSORS[int(payloads[0, -1])])
    table = table_of_returns(returns, device.firing_sequence_us or 0.0)
    mode = MODES[int(payloads[0, -2])]
    if mode == "last":
        table["return_kind"][:] = LAST
    table["turn"][:] = _turn_numbers(returns)
    return replace(table, about={**table.about, "returns": mode, "packets": len(payloads)})


def _turn_numbers(returns: Returns) -> NDArray[np.int32]:
    """Return how often the azimuth of firings passed 0 before each return."""
    passed, previous = 0, 0
    numbers: list[NDArray[np.int64]] = []
    for turn in returns.turns:
        columns, lasers, _ = returns.indices(turn)
        azimuths = turn.azimuths.astype(np.int64)
        falls = np.diff(azimuths, prepend=previous if numbers else azimuths[:1]) < -CENTIDEGREES / 2
        blocks = passed + np.cumsum(falls)
        over = returns.column_azimuths(turn)[columns, lasers] >= 2 * np.pi
        numbers.append(blocks[columns // returns.layout.columns_per_block] + over)
        passed, previous = int(blocks[-1]), int(azimuths[-1])
    return np.concatenate(numbers).astype(np.int32)


def packets_of(kind: PacketKind, turn: Turn) -> Payloads:
    """Convert a turn back to packets (p, 1206), the inverse of `turn_of`."""
    layout = kind.layout
    if turn.times is None or turn.reflectivities is None:
        raise InputError("the stream has no times or reflectivities, which packets need")
    if len(turn.azimuths) != len(turn.times) * layout.blocks_per_time:
        raise InputError("the stream holds a packet that is not whole")
    if turn.ranges.max(initial=0) > 0xFFFF:
        raise InputError("a range exceeds the 16 bits of a packet")
    packets = np.zeros(len(turn.times), dtype=PACKET)
    blocks = packets["blocks"]
    blocks["flag"] = FLAG
    azimuths = turn.azimuths.reshape(len(packets), -1)
    blocks["azimuth"] = np.repeat(azimuths, layout.kinds, axis=1)
    blocks["returns"]["distance"] = _blocked(kind, turn.ranges)
    blocks["returns"]["reflectivity"] = _blocked(kind, turn.reflectivities)
    packets["time_us"], packets["mode"], packets["product"] = turn.times, kind.mode, kind.product
    return packets.view(np.uint8).reshape(-1, PACKET_BYTES)


def _viewed(payloads: Payloads) -> NDArray[np.void]:
    viewed: NDArray[np.void] = np.ascontiguousarray(payloads).view(PACKET)[:, 0]
    return viewed


def _imaged(kind: PacketKind, values: NDArray[Any]) -> NDArray[Any]:
    layout = kind.layout
    paired = values.reshape(-1, layout.kinds, _CHANNELS)[:, ::-1]
    images = paired.transpose(1, 0, 2).reshape(layout.kinds, -1, layout.lasers)
    return np.ascontiguousarray(images)


def _blocked(kind: PacketKind, images: NDArray[Any]) -> NDArray[Any]:
    paired = images.reshape(kind.layout.kinds, -1, _CHANNELS).transpose(1, 0, 2)[:, ::-1]
    return paired.reshape(-1, BLOCKS, *BLOCK["returns"].shape)
