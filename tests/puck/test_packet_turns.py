"""Packets as turns: against a search through the bytes, and packets that are damaged by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.lidar.return_table import BOTH
from pointkit.lidar.return_table import LAST as LAST_RETURN
from pointkit.lidar.return_table import STRONGEST as STRONGEST_RETURN
from puck.recordings import packet_turns
from puck.recordings.packet_turns import (
    decode_packets,
    find_packets,
    is_whole,
    packet_kind,
    packets_of,
    returns_of_packets,
    split_turns,
    turn_of,
)
from tests.support.spinning import (
    BLOCKS,
    DUAL,
    HDL32E,
    HDL64E,
    PACKET,
    PUCK_HIRES,
    STRONGEST,
    VLP16,
    VLP32C,
    VLS128,
    rows,
    spin,
)

LAST = 0x38
PRODUCTS = (VLP16, PUCK_HIRES, HDL32E, VLP32C, HDL64E, VLS128)
KINDS = [(product, mode) for product in PRODUCTS for mode in (STRONGEST, DUAL)]


def changed(payloads: NDArray[np.uint8], packet: int, byte: int, value: int) -> NDArray[np.uint8]:
    """Packets of which one has another byte."""
    other = payloads.copy()
    other[packet, byte] = value
    return other


def at(azimuths: list[int]) -> NDArray[np.uint8]:
    """Packets of a Puck whose blocks have these azimuths, twelve to a packet."""
    payloads = spin(packets=len(azimuths) // 12)
    payloads.view(PACKET)["blocks"]["azimuth"] = np.reshape(azimuths, (-1, 1, 12))
    return payloads


@pytest.mark.parametrize(
    ("product", "mode", "columns", "blocks", "kinds", "lasers"),
    [
        (VLP16, STRONGEST, 2, 12, 1, 16),
        (PUCK_HIRES, LAST, 2, 12, 1, 16),
        (VLP16, DUAL, 2, 6, 2, 16),
        (HDL32E, STRONGEST, 1, 12, 1, 32),
        (HDL32E, DUAL, 1, 6, 2, 32),
        (VLP32C, STRONGEST, 1, 12, 1, 32),
        (VLP32C, DUAL, 1, 6, 2, 32),
        (HDL64E, STRONGEST, 1, 6, 1, 64),
        (HDL64E, DUAL, 1, 3, 2, 64),
        (VLS128, STRONGEST, 1, 3, 1, 128),
        (VLS128, DUAL, 1, 1, 2, 128),
    ],
)
def test_layouts_are_those_of_the_manuals(
    product: int, mode: int, columns: int, blocks: int, kinds: int, lasers: int
) -> None:
    layout = packet_kind(product, mode).layout
    assert (layout.columns_per_block, layout.blocks_per_time) == (columns, blocks)
    assert (layout.kinds, layout.lasers) == (kinds, lasers)


def test_a_packet_of_another_sensor_or_mode_has_no_kind() -> None:
    with pytest.raises(InputError, match=r"packets of Velarray \(product 0x31\), not of VLP-16, P"):
        packet_kind(0x31, STRONGEST)
    with pytest.raises(InputError, match=r"packets of an unknown sensor \(product 0x7F\)"):
        packet_kind(0x7F, STRONGEST)
    with pytest.raises(InputError, match="return mode 0x12"):
        packet_kind(VLP16, 0x12)


def test_packets_are_found_wherever_they_are_in_the_bytes() -> None:
    """With nothing, few and many other bytes around them; the last one ends with the bytes."""
    packets = [rows(spin(*kind, packets=1))[0] for kind in KINDS]
    data, places = b"\xff" * 97, []
    for gap, packet in enumerate(packets):
        places.append(len(data))
        data += packet + b"\xff\xee" * (gap % 3)
    assert len(data) - places[-1] == 1206 + 4
    assert find_packets(np.frombuffer(data, np.uint8)).tolist() == places
    assert find_packets(np.frombuffer(data[:-4], np.uint8)).tolist() == places
    assert find_packets(np.frombuffer(data[:-5], np.uint8)).tolist() == places[:-1]
    assert find_packets(np.frombuffer(packets[0], np.uint8)).tolist() == [0]
    assert find_packets(np.frombuffer(packets[0][:-1], np.uint8)).tolist() == []


def test_what_is_damaged_is_no_packet() -> None:
    (single,), (dual,) = spin(packets=1), spin(mode=DUAL, packets=1)
    faults = [(100 * block + byte, 0) for block in range(12) for byte in (0, 1)]
    faults += [(1204, 0x12), (1205, 0x63)]
    for byte, value in faults:
        assert len(find_packets(changed(single[None], 0, byte, value)[0])) == 0
    for byte in [100 * block + byte for block in range(12) for byte in (2, 3)]:
        other = changed(dual[None], 0, byte, dual[byte] ^ 1)[0]
        assert len(find_packets(other)) == 0  # the other block of the pair has another azimuth
        assert len(find_packets(changed(single[None], 0, byte, single[byte] ^ 1)[0])) == 1


def test_packets_that_overlap_one_before_are_none() -> None:
    """Two packets could begin 100 bytes apart, and one follows the first."""
    block = b"\xff\xee" + bytes(98)
    data = bytearray(block * 12 + bytes(6) + block * 12 + bytes(6))
    data[1200:1202] = b"\xff\xee"
    for end in (1206, 1306, 2412):
        data[end - 2 : end] = bytes([STRONGEST, VLP16])
    assert find_packets(np.frombuffer(bytes(data), np.uint8)).tolist() == [0, 1206]
    result = packet_turns.without_overlaps(np.array([0, 100, 1205, 1206, 2000, 2412]))
    assert result.tolist() == [0, 1206, 2412]


def test_a_turn_begins_with_the_packet_that_passes_azimuth_zero() -> None:
    """Ten packets of 24 degrees each; the second turn's first block may begin a packet or not."""
    for shift in (0, 5, 11):
        azimuths = (36000 - 200 * (5 * 12 + shift) + 200 * np.arange(120)) % 36000
        turns = [len(part) for _, part in split_turns(at(azimuths.tolist()))]
        assert turns == [5, 5]


def test_an_azimuth_that_falls_by_half_a_turn_is_not_over_zero() -> None:
    """An encoder may step back; only what is nearer the other way round is a new turn."""
    steps = [20000] * 12 + [19999] + [20000] * 11
    for low, turns in ((2000, 1), (1999, 2)):
        assert len(list(split_turns(at([*steps, *[low] * 12])))) == turns


def test_a_turn_ends_where_another_kind_of_packet_follows() -> None:
    payloads = np.concatenate([at([100] * 36), at([100] * 24), at([100] * 12)])
    payloads[3:5, 1204] = LAST
    payloads[5:, 1205] = PUCK_HIRES
    result = [(kind.product, kind.mode, len(part)) for kind, part in split_turns(payloads)]
    assert result == [(VLP16, STRONGEST, 3), (VLP16, LAST, 2), (PUCK_HIRES, STRONGEST, 1)]


def test_a_sensor_that_does_not_turn_has_turns_of_682_packets() -> None:
    """The most of 16,384 columns that whole packets of 24 columns fill."""
    payloads = np.repeat(at([100] * 12), 1366, axis=0)
    assert [len(part) for _, part in split_turns(payloads)] == [682, 682, 2]


@pytest.mark.parametrize(("product", "mode"), KINDS)
def test_an_image_has_the_numbers_of_its_packets(product: int, mode: int) -> None:
    """The strongest return is the first kind."""
    payloads = spin(product, mode, packets=3)
    packets = payloads.view(PACKET)[:, 0]
    kind = packet_kind(product, mode)
    turn = turn_of(kind, payloads)
    lasers = kind.layout.lasers
    assert turn.times is not None
    assert turn.times.tolist() == packets["time"].tolist()
    assert turn.reflectivities is not None
    images = (turn.ranges, turn.reflectivities)
    order = BLOCKS.get((product, mode), ["0l", "0s"] if mode == DUAL else ["0s"])
    firings = 12 // len(order)
    for number in range(3 * firings * len(order)):
        firing, place = divmod(number, len(order))
        bank, is_last = int(order[place][0]), order[place][1] == "l"
        block = packets[firing // firings]["blocks"][firing % firings * len(order) + place]
        assert turn.azimuths[firing] == block["azimuth"]
        for channel in range(32):
            column = firing * max(32 // lasers, 1) + channel // lasers
            laser = (32 * bank + channel) % lasers
            assert [image[int(is_last), column, laser] for image in images] == list(
                block["returns"][channel]
            )
    rest = payloads[:, kind.rest]
    assert rest.shape[1] == {(HDL64E, 1): 2, (HDL64E, 2): 2, (VLS128, 2): 400}.get(
        (product, kind.layout.kinds), 0
    )
    assert np.array_equal(packets_of(kind, turn, rest), payloads)


@pytest.mark.parametrize(("product", "mode"), KINDS[8:])
def test_blocks_of_a_firing_have_one_azimuth_and_the_flags_of_their_banks(
    product: int, mode: int
) -> None:
    payloads = spin(product, mode, packets=2)
    assert is_whole(payloads).all()
    for byte, value in ((102, payloads[1, 102] ^ 1), (101, 0)):
        other = changed(payloads, 1, byte, int(value))
        assert is_whole(other).tolist() == [True, False]
        assert find_packets(other.ravel()).tolist() == [0]


def test_packets_are_whole_with_their_flags_and_azimuths_below_360_degrees() -> None:
    payloads, dual = at([35999] * 36), spin(mode=DUAL, packets=3)
    assert is_whole(payloads).tolist() == is_whole(dual).tolist() == [True] * 3
    for block in (0, 11):
        payloads.view(PACKET)["blocks"]["azimuth"][1, 0, block] = 36000
        assert is_whole(payloads).tolist() == [True, False, True]
        payloads.view(PACKET)["blocks"]["azimuth"][1, 0, block] = 35999
        assert is_whole(changed(payloads, 2, 100 * block, 0)).tolist() == [True, True, False]
        other = changed(dual, 0, 100 * block + 2, dual[0, 100 * block + 2] ^ 1)
        assert is_whole(other).tolist() == [False, True, True]


def test_packets_that_are_no_returns_are_refused() -> None:
    payloads = spin(packets=6)
    with pytest.raises(InputError, match="no data packets"):
        returns_of_packets(payloads[:0])
    with pytest.raises(InputError, match="packet 3 is damaged"):
        returns_of_packets(changed(changed(payloads, 3, 0, 0), 5, 0, 0))
    with pytest.raises(InputError, match="more than one sensor or return mode"):
        returns_of_packets(changed(payloads, 5, 1204, LAST))
    assert len(returns_of_packets(payloads).turns) == 1


def test_turns_that_are_not_of_whole_packets_are_refused() -> None:
    kind = packet_kind(VLP16, STRONGEST)
    turn = turn_of(kind, spin(packets=3))
    for lacking in (replace(turn, times=None), replace(turn, reflectivities=None)):
        with pytest.raises(InputError, match="no times or reflectivities"):
            packets_of(kind, lacking)
    with pytest.raises(InputError, match="a packet that is not whole"):
        packets_of(kind, replace(turn, azimuths=turn.azimuths[:-1]))


@pytest.mark.parametrize(
    ("name", "product", "mode", "firings", "angle_deg"),
    [
        ("hdl64e", HDL64E, STRONGEST, 6, 0.02),
        ("hdl64e_dual", HDL64E, DUAL, 3, 0.025),
        ("vls128", VLS128, STRONGEST, 3, 0.03),
        ("vls128_dual", VLS128, DUAL, 1, 0.03),
    ],
)
def test_packets_of_banks_decode_as_velodyne_decoder_decodes_them(
    name: str, product: int, mode: int, firings: int, angle_deg: float
) -> None:
    """It rounds azimuths to 0.01 degrees, averages the rotation (jitter: 0.01) and of a VLS-128
    pauses for one group more; the rotation in its first packet is unknown to it.
    """
    other = np.load(Path(__file__).parents[1] / "data" / "capture" / "banks.npz")
    table = decode_packets(spin(product, mode, packets=5, rise=20))
    column = np.cumsum(np.diff(table["laser_id"], prepend=0) < 0)
    table = table.select(column >= firings)
    assert table["laser_id"].tolist() == other[f"{name}_laser"].tolist()
    kinds = {STRONGEST_RETURN: 1, LAST_RETURN: 2, BOTH: 3}
    assert [kinds[each] for each in table["return_kind"]] == other[f"{name}_kind"].tolist()
    error = np.linalg.norm(table.xyz - other[f"{name}_xyz"], axis=1)
    assert (error < np.radians(angle_deg) * table["distance"] + 0.0002).all()
