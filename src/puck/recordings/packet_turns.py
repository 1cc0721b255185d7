"""Conversion between data packets of Velodyne sensors and turns (range images of revolutions).

Manuals: VLP-16 63-9243 Rev. E, chapter 9; HDL-32E 63-9113 Rev. M, appendix C; VLP-32C 63-9325;
HDL-64E 63-HDL64ES2 and 63-HDL64ES3 (one format); Alpha Prime (VLS-128) 63-9483, section 9.3.

All banks of an Alpha Prime's firing have the azimuth of its first lasers (section 9.5 of the
manual, velodyne_decoder, a recording by TIER IV). ROS's driver interpolates between blocks.

Packets of an HDL-64E state neither sensor nor return mode; both follow from flags and equal
azimuths, as in velodyne_decoder. A single return counts as the strongest.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from itertools import product as pairs_of
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.lidar.return_table import LAST, ReturnTable, return_table_of
from pointkit.lidar.returns import USUAL_QUANTUM_M, Beams, Returns
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.turns import CENTIDEGREES, Layout, Turn
from puck.recordings.packets import (
    BANK_FLAGS,
    BLOCK,
    BLOCKS,
    DUAL_MODE,
    HDL64E,
    MODES,
    PACKET,
    PACKET_BYTES,
    PRODUCTS,
    STRONGEST_MODE,
    VLP16,
    VLS128,
)

SENSORS = {
    VLP16: "vlp16",
    0x24: "puck_hires",
    0x21: "hdl32e",
    0x28: "vlp32c",
    HDL64E: "hdl64e_s3",
    VLS128: "alpha_prime",
}
"""Names of sensors by the product byte of their packets."""
_BANKS = {HDL64E: 2, VLS128: 4}
_CHANNELS = 32
_BLOCK_BYTES = BLOCK.itemsize
_MOST_AT_ONCE = 4096
"""Number of packets compared at a time."""
_STATUS_BYTES = 2
"""Size of the status that ends an HDL-64E's packet, where other packets have mode and product."""

Payloads = NDArray[np.uint8]


@dataclass(frozen=True)
class PacketKind:
    """Kind of a Velodyne's data packets, and the layout of the images in which they are coded.

    Parameters
    ----------
    product
        Code of the sensor, as in a packet's last byte: 0x22 is a VLP-16.
    mode
        Code of the return mode, as in a packet's last byte but one: 0x37 reports a beam's strongest
        return, 0x38 the last return, 0x39 both.
    layout
        Arrangement of lasers and columns in the images of a `Turn`.
    """

    product: int
    mode: int
    layout: Layout

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Indices of a packet's blocks, (firings, kinds of return, banks), strongest first."""
        return _blocks(self.product, self.mode)

    @property
    def rest(self) -> slice:
        """Bytes of a packet that no turn holds, as a slice: status, or blocks without lasers."""
        if self.product == HDL64E:
            return slice(PACKET_BYTES - _STATUS_BYTES, PACKET_BYTES)
        return slice(self.blocks.size * _BLOCK_BYTES, BLOCKS * _BLOCK_BYTES)

    @property
    def has_rest(self) -> bool:
        """Whether packets have bytes that no turn holds (see `rest`)."""
        return self.product == HDL64E or self.blocks.size < BLOCKS

    def returns(self, turns: Iterable[Turn], sensor: Sensor | None = None) -> Returns:
        """Return turns together with the beams of the sensor, as `Returns`.

        Parameters
        ----------
        turns
            Revolutions in chronological order.
        sensor
            Description of the lasers; by default, the nominal one of the product code.

        Raises
        ------
        InputError
            The sensor has another number of lasers, or no firing times.
        """
        sensor = sensor or load_sensor(SENSORS[self.product])
        if sensor.lasers != self.layout.lasers or sensor.firing_sequence_us is None:
            lasers = f"{self.layout.lasers} lasers and their firing times"
            raise InputError(f"sensor {sensor.name} is not described with {lasers}")
        quantum = (sensor.range_quantum_mm or 0.0) / 1000 or USUAL_QUANTUM_M
        return Returns(Beams.of(sensor), self.layout, tuple(turns), quantum, sensor.name)


@cache
def packet_kind(product: int, mode: int) -> PacketKind:
    """Return the kind of packets with a product code and a return mode.

    Parameters
    ----------
    product, mode
        Codes of the sensor and of its return mode, as in `PacketKind`.

    Raises
    ------
    InputError
        The sensor or the mode is not supported.
    """
    if product not in SENSORS:
        name = PRODUCTS.get(product, "an unknown sensor")
        listed = ", ".join(PRODUCTS[each] for each in SENSORS)
        raise InputError(f"packets of {name} (product 0x{product:02X}), not of {listed}")
    if mode not in MODES:
        raise InputError(f"return mode 0x{mode:02X}, where one of 0x37, 0x38, 0x39 is expected")
    sensor = load_sensor(SENSORS[product])
    order = tuple(int(laser) for laser in np.argsort(sensor.laser_elevation_deg, kind="stable"))
    ahead = np.array(sensor.laser_azimuth_deg or ()) / sensor.azimuth_step_deg
    shifts = tuple(np.rint(ahead).astype(int).tolist())
    firings, kinds, _ = _blocks(product, mode).shape
    columns = max(_CHANNELS // sensor.lasers, 1)
    return PacketKind(product, mode, Layout(order, columns, firings, kinds, shifts=shifts))


@cache
def _blocks(product: int, mode: int) -> NDArray[np.int64]:
    banks, kinds = _BANKS.get(product, 1), 2 if mode == DUAL_MODE else 1
    firings = BLOCKS // (banks * kinds)
    numbers = np.arange(firings * kinds * banks)
    if product == HDL64E:  # both banks of the strongest return, then of the last
        return numbers.reshape(firings, kinds, banks)
    return numbers.reshape(firings, banks, kinds)[..., ::-1].swapaxes(1, 2)


@cache
def _flags(product: int, mode: int) -> NDArray[np.int64]:
    blocks = _blocks(product, mode)
    flags = np.zeros(blocks.size, np.int64)
    flags[blocks] = BANK_FLAGS[: blocks.shape[2]]
    return flags


def kind_codes(payloads: Payloads) -> NDArray[np.int64]:
    """Return the product code and the return mode of each packet (p, 1206), as an array (p, 2)."""
    codes = payloads[:, :-3:-1].astype(np.int64)
    blocks = _viewed(payloads)["blocks"]
    is_64 = (blocks["flag"] == _flags(HDL64E, STRONGEST_MODE)).all(axis=1)
    firings = blocks["azimuth"].reshape(-1, BLOCKS // 4, 4)
    is_dual = (firings == firings[..., :1]).all(axis=(1, 2))
    modes = np.where(is_dual, DUAL_MODE, STRONGEST_MODE)
    codes[is_64] = np.column_stack([np.full(len(codes), HDL64E), modes])[is_64]
    return codes


def find_packets(data: Payloads) -> NDArray[np.int64]:
    """Return the positions in `data` at which data packets of `SENSORS` begin, ascending."""
    last = len(data) - PACKET_BYTES + 1
    if last < 1:
        return np.zeros(0, np.int64)
    low, high = BANK_FLAGS[0] & 255, BANK_FLAGS[0] >> 8
    first = np.flatnonzero((data[:last] == low) & (data[1 : last + 1] == high))
    patterns: dict[tuple[int, ...], set[int]] = {}
    for product, mode in pairs_of(SENSORS, MODES):
        patterns.setdefault(tuple(_flags(product, mode).tolist()), set()).add(product)
    parts = [_with_flags(data, first, *pattern) for pattern in patterns.items()]
    places = np.unique(np.concatenate(parts))
    for start in range(0, len(places), _MOST_AT_ONCE):
        some = places[start : start + _MOST_AT_ONCE]
        packets = data[some[:, None] + np.arange(PACKET_BYTES)]
        codes = kind_codes(packets)
        some[~(is_whole(packets, codes) & _is_supported(codes))] = -1
    return without_overlaps(places[places >= 0])


def _with_flags(
    data: Payloads, places: NDArray[np.int64], flags: tuple[int, ...], products: set[int]
) -> NDArray[np.int64]:
    for block, flag in enumerate(flags[1:], 1):
        at = places + block * _BLOCK_BYTES
        places = places[(data[at] == flag & 255) & (data[at + 1] == flag >> 8)]
    if HDL64E in products:
        return places
    return places[np.isin(data[places + PACKET_BYTES - 1], list(products))]


def without_overlaps(places: NDArray[np.int64], size: int = PACKET_BYTES) -> NDArray[np.int64]:
    """Return those of the ascending `places` whose packets overlap no earlier packet that is kept.

    Each packet has `size` bytes.
    """
    if (np.diff(places) >= size).all():
        return places
    kept: list[int] = []
    for place in places.tolist():
        if not kept or place >= kept[-1] + size:
            kept.append(place)
    return np.array(kept, np.int64)


def split_turns(payloads: Payloads) -> Iterator[tuple[PacketKind, Payloads]]:
    """Split packets (p, 1206) into revolutions, and yield the kind and the packets of each.

    A revolution begins with the packet that passes azimuth 0. It also ends where the sensor or the
    return mode changes, or after `Layout.max_blocks` blocks.
    """
    codes = kind_codes(payloads)
    ends = np.flatnonzero((np.diff(codes, axis=0) != 0).any(axis=1)) + 1
    for begin, stop in pairwise([0, *ends.tolist(), len(payloads)]):
        kind = packet_kind(*codes[begin].tolist())
        packets = _viewed(payloads[begin:stop])
        azimuths = packets["blocks"]["azimuth"][:, kind.blocks[:, 0, 0]].astype(np.int64)
        before = np.concatenate([azimuths[:1, 0], azimuths[:-1, -1]])
        falls = np.diff(azimuths, axis=1, prepend=before[:, None]) < -CENTIDEGREES // 2
        falls[:1] = True
        edges = [*(np.flatnonzero(falls.any(axis=1)) + begin).tolist(), stop]
        most = kind.layout.max_blocks // kind.layout.blocks_per_time
        for first, end in pairwise(edges):
            for start in range(first, end, most):
                yield kind, payloads[start : min(start + most, end)]


def turn_of(kind: PacketKind, payloads: Payloads) -> Turn:
    """Convert the packets (p, 1206) of a revolution to a turn.

    Of two returns of a beam, the strongest comes first.
    """
    packets = _viewed(payloads)
    blocks = packets["blocks"]
    return Turn(
        _imaged(kind, blocks["returns"]["distance"]),
        np.ascontiguousarray(blocks["azimuth"][:, kind.blocks[:, 0, 0]].ravel()),
        packets["time_us"].astype(np.uint32),
        _imaged(kind, blocks["returns"]["reflectivity"]),
    )


def is_whole(payloads: Payloads, codes: NDArray[np.int64] | None = None) -> NDArray[np.bool_]:
    """Return a mask (p,) of the packets (p, 1206) whose flags and azimuths are valid.

    Blocks of a firing must have equal azimuths. Packets of unknown sensors are checked as a
    VLP-16's. The argument `codes` is the result of `kind_codes` for the packets; by default, it is
    computed.
    """
    packets, is_valid = _viewed(payloads)["blocks"], np.zeros(len(payloads), np.bool_)
    codes = kind_codes(payloads) if codes is None else codes.copy()
    codes[~_is_supported(codes)] = VLP16, STRONGEST_MODE
    for code in np.unique(codes, axis=0).tolist():
        rows, numbers = np.flatnonzero((codes == code).all(axis=1)), _blocks(*code)
        azimuths = packets["azimuth"][rows][:, numbers]
        is_azimuth = (azimuths < CENTIDEGREES) & (azimuths == azimuths[:, :, :1, :1])
        has_flags = packets["flag"][rows, : numbers.size] == _flags(*code)
        is_valid[rows] = has_flags.all(axis=1) & is_azimuth.all(axis=(1, 2, 3))
    return is_valid


def _is_supported(codes: NDArray[np.int64]) -> NDArray[np.bool_]:
    return np.isin(codes[:, 0], list(SENSORS)) & np.isin(codes[:, 1], list(MODES))


def returns_of_packets(payloads: Payloads, sensor: Sensor | None = None) -> Returns:
    """Decode packets to the returns of one sensor, split into revolutions.

    Parameters
    ----------
    payloads
        Data packets (p, 1206), in the order in which the sensor sent them.
    sensor
        Description of the lasers; by default, the nominal one of the packets' product.

    Returns
    -------
    Returns
        The revolutions, of which the first and the last may be incomplete, and the beams.

    Raises
    ------
    InputError
        There is no packet, a packet is damaged, or packets are of several sensors or return modes.
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


def decode_packets(payloads: Payloads, sensor: Sensor | None = None) -> ReturnTable:
    """Decode packets to a table with a row for each return.

    Parameters and errors are those of `returns_of_packets`.

    Returns
    -------
    ReturnTable
        The returns, with the number of the revolution as turn. The attribute ``about`` tells
        sensor, return mode and number of packets, and the numbers of the first whole turn and of
        the turn after the last whole one (``whole_turns``).
    """
    returns = returns_of_packets(payloads, sensor)
    product, number = kind_codes(payloads[:1])[0].tolist()
    device, mode = sensor or load_sensor(SENSORS[product]), MODES[number]
    table = return_table_of(returns, device.firing_sequence_us or 0.0)
    if mode == "last":
        table["return_kind"][:] = LAST
    whole = [1, max(len(returns.turns) - 1, 1)]
    about = {"returns": mode, "packets": len(payloads), "whole_turns": whole}
    return replace(table, about={**table.about, **about})


def packets_of(kind: PacketKind, turn: Turn, rest: Payloads | None = None) -> Payloads:
    """Convert a turn back to the data packets that `turn_of` converted.

    Parameters
    ----------
    kind
        Sensor and return mode of the packets.
    turn
        A revolution of whole packets, with times and reflectivities.
    rest
        Bytes (p, r) of each packet that the turn does not hold, which are at `PacketKind.rest`; by
        default 0.

    Returns
    -------
    array (p, 1206) of uint8
        The UDP payloads.

    Raises
    ------
    InputError
        Packets cannot hold the turn: it lacks times or reflectivities, is not of whole packets, or
        has a range of more than 16 bits.
    """
    layout = kind.layout
    if turn.times is None or turn.reflectivities is None:
        raise InputError("the stream has no times or reflectivities, which packets need")
    if len(turn.azimuths) != len(turn.times) * layout.blocks_per_time:
        raise InputError("the stream holds a packet that is not whole")
    if turn.ranges.max(initial=0) > 0xFFFF:
        raise InputError("a range exceeds the 16 bits of a packet")
    packets = np.zeros(len(turn.times), dtype=PACKET)
    blocks = packets["blocks"]
    blocks["flag"][:, : kind.blocks.size] = _flags(kind.product, kind.mode)
    azimuths = turn.azimuths.reshape(len(packets), -1)
    blocks["azimuth"][:, kind.blocks] = azimuths[..., None, None]
    _put(kind, blocks["returns"]["distance"], turn.ranges)
    _put(kind, blocks["returns"]["reflectivity"], turn.reflectivities)
    packets["time_us"], packets["mode"], packets["product"] = turn.times, kind.mode, kind.product
    payloads = packets.view(np.uint8).reshape(-1, PACKET_BYTES)
    payloads[:, kind.rest] = 0 if rest is None else rest
    return payloads


def _viewed(payloads: Payloads) -> NDArray[np.void]:
    viewed: NDArray[np.void] = np.ascontiguousarray(payloads).view(PACKET)[:, 0]
    return viewed


def _imaged(kind: PacketKind, values: NDArray[Any]) -> NDArray[Any]:
    layout, channels = kind.layout, values.reshape(len(values), BLOCKS, _CHANNELS)
    images = channels[:, kind.blocks].transpose(2, 0, 1, 3, 4)
    return np.ascontiguousarray(images.reshape(layout.kinds, -1, layout.lasers))


def _put(kind: PacketKind, values: NDArray[Any], images: NDArray[Any]) -> None:
    firings, kinds, banks = kind.blocks.shape
    paired = images.reshape(kinds, len(values), firings, banks, 2, -1)
    values[:, kind.blocks] = paired.transpose(1, 2, 0, 3, 4, 5)
