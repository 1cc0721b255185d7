"""What returns are stored in today: the bytes inside are those of other programs."""

import lzma
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.zstandard import compressed, decompressed
from pointkit.errors import InputError
from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.turns import Layout, Turn
from puck import records
from puck.recordings.packet_turns import returns_of_packets
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.registry import open_codec
from puckbench.codecs.returns_codec import ReturnsCodec
from puckbench.codecs.storage import packets
from puckbench.codecs.storage import range_images as range_image
from puckbench.metrics.sensor_metrics import range_errors
from tests.support.codecs import decode, decode_returns, encode_returns
from tests.support.returns import dual, homemade, recorded
from tests.support.spinning import HDL32E, HDL64E, PUCK_HIRES, VLP16, VLP32C, VLS128, spin

UNPACK = {"packets_xz": lzma.decompress, "packets_zstd": lambda data: decompressed(data, 10**7)}
IMAGES = ("jpegls", "jpegxl")


def _opened(name: str) -> ReturnsCodec:
    codec = open_codec(name)
    assert isinstance(codec, ReturnsCodec)
    if why_not_here(codec):
        pytest.skip(why_not_here(codec))
    return codec


def _framed(magic: bytes, body: bytes) -> bytes:
    return magic + b"\1" + struct.pack("<I", zlib.crc32(body)) + body


@pytest.mark.parametrize("name", UNPACK)
@pytest.mark.parametrize("product", [VLP16, PUCK_HIRES, HDL32E, VLP32C, HDL64E, VLS128])
def test_the_packets_of_a_recording_are_in_the_stream_as_they_came(name: str, product: int) -> None:
    payloads = spin(product, packets=150)
    payloads[:, -2:] *= product != HDL64E  # its status
    returns = returns_of_packets(payloads)
    stream = encode_returns(_opened(name), returns, "2mm")
    reader = Reader(stream[9:])
    counts = [reader.number() for _ in range(reader.number())]
    assert sum(counts) == len(payloads)
    assert len(counts) == len(returns.turns)
    assert UNPACK[name](reader.rest()) == payloads.tobytes()
    decoded = decode_returns(_opened(name), stream)
    for turn, other in zip(returns.turns, decoded.turns, strict=True):
        np.testing.assert_array_equal(turn.times, other.times)
        np.testing.assert_array_equal(turn.reflectivities, other.reflectivities)


def test_packets_hold_zeros_for_what_returns_do_not_have() -> None:
    returns = recorded()
    bare = replace(
        returns,
        turns=tuple(replace(turn, times=None, reflectivities=None) for turn in returns.turns),
    )
    codec = _opened("packets_zstd")
    decoded = decode_returns(codec, encode_returns(codec, bare, "2mm"))
    np.testing.assert_array_equal(decoded.points(), returns.points())
    times, reflectivities = decoded.turns[0].times, decoded.turns[0].reflectivities
    assert times is not None
    assert reflectivities is not None
    assert not times.any()
    assert not reflectivities.any()


@pytest.mark.parametrize("name", UNPACK)
def test_returns_that_no_packet_holds_are_refused(name: str) -> None:
    codec, whole = _opened(name), recorded()
    virtual = replace(whole, beams=replace(whole.beams, clockwise=False))
    turn = whole.turns[0]
    cut = replace(
        turn, azimuths=turn.azimuths[:-1], ranges=turn.ranges[:, :-2], reflectivities=None
    )
    for returns, fault in (
        (homemade(), "encodes only returns of Velodynes"),
        (virtual, "encodes only returns of Velodynes"),
        (replace(whole, turns=(cut,)), "not of whole data packets"),
    ):
        with pytest.raises(InputError, match=fault):
            encode_returns(codec, returns, "2mm")


@pytest.mark.parametrize(
    ("name", "pack", "magic"),
    [("packets_xz", lzma.compress, b"PBPX"), ("packets_zstd", compressed, b"PBPZ")],
)
def test_packets_that_unpack_to_too_much_are_refused(name: str, pack, magic: bytes) -> None:  # noqa: ANN001
    packets = spin(packets=24).tobytes()
    for count, data, fault in (
        (24, packets + packets, "damaged"),
        (24, packets[:-1], "damaged"),
        (10**9, packets, "1000000000 data packets in"),
        (24, packets[:-1] + b"\x28", "several sensors"),
    ):
        with pytest.raises(InputError, match=fault):
            decode(_opened(name), _framed(magic, b"\1" + base_128(count) + pack(data)))


def _parts(stream: bytes) -> list[bytes]:
    reader = Reader(stream[9:])
    parts = []
    while reader.at < len(reader.body):
        parts.append(reader.take(reader.number()))
    return parts


def _image_of(name: str, part: bytes) -> np.ndarray:
    imagecodecs = pytest.importorskip("imagecodecs")
    if name == "jpegls":
        return imagecodecs.jpegls_decode(part[1:])
    return imagecodecs.jpegxl_decode(part)


@pytest.mark.parametrize("name", IMAGES)
def test_the_image_is_of_lasers_from_the_highest_down(name: str) -> None:
    returns = homemade()
    stream = encode_returns(_opened(name), returns, "2mm")
    image = _image_of(name, _parts(stream)[-1])
    downwards = [3, 0, 2, 4, 1]
    np.testing.assert_array_equal(image, returns.turns[-1].ranges[0][:, downwards].T)


@pytest.mark.parametrize("name", IMAGES)
def test_a_second_return_like_the_first_is_0_in_its_image(name: str) -> None:
    returns = dual()
    codec = _opened(name)
    stream = encode_returns(codec, returns, "2mm")
    first, second = (_image_of(name, part) for part in _parts(stream)[-2:])
    np.testing.assert_array_equal(
        second == 0,
        (returns.turns[-1].ranges[1] == returns.turns[-1].ranges[0])[
            :, list(returns.layout.order)[::-1]
        ].T,
    )
    assert first.shape == second.shape
    np.testing.assert_array_equal(
        decode_returns(codec, stream).turns[-1].ranges, returns.turns[-1].ranges
    )


@pytest.mark.parametrize("name", IMAGES)
def test_every_range_that_16_bits_hold_keeps_within_half_a_step(name: str) -> None:
    ranges = np.zeros((2, 300, 2), np.uint16)
    ranges[0, :, 0] = np.arange(1, 301)
    ranges[0, :, 1] = np.arange(65535, 65235, -1)
    ranges[1, ::2] = ranges[0, ::2]
    ranges[1, 1::4, 0] = 7
    ranges[1, 1::4, 1] = 65535
    azimuths = np.random.default_rng(0).integers(0, 65536, 300).astype(np.uint16)
    beams = Beams((1.0, -1.0), (0.0, 0.0), (0.0, 0.0))
    returns = Returns(beams, Layout((1, 0), kinds=2), (Turn(ranges, azimuths),), 0.002, "Two")
    codec = _opened(name)
    for rate, parameters in codec.rates.items():
        decoded = decode_returns(codec, encode_returns(codec, returns, rate))
        errors = range_errors(returns, decoded)
        assert errors["range_max_mm"] <= 500 * parameters["step_m"] + 1e-6
        assert errors["returns_lost"] == errors["returns_added"] == 0
        np.testing.assert_array_equal(decoded.turns[0].azimuths, azimuths)
    np.testing.assert_array_equal(decoded.turns[0].ranges, ranges)


@pytest.mark.parametrize(("name", "magic"), [("jpegls", b"PBJL"), ("jpegxl", b"PBJX")])
def test_streams_that_claim_too_much_are_refused(name: str, magic: bytes) -> None:
    codec = _opened(name)
    layout, beams, numbers, azimuths, image, *_ = _parts(encode_returns(codec, homemade(), "2mm"))
    blocks = base_128(16384)
    for changed, fault in (
        ([layout, beams, b"\1\1" + base_128(10**6), azimuths, image], "its turns"),
        ([layout, beams, b"\1" + base_128(100) + blocks * 100, azimuths, image], "pixels in"),
        ([layout, beams, b"\0" + numbers[1:], azimuths, image], "its numbers"),
        ([layout, beams, b"\1\1" + base_128(89), azimuths, image], "damaged"),
        ([layout, beams, b"\1\1" + base_128(90), azimuths, image[:50]], "damaged"),
    ):
        body = b"".join(base_128(len(part)) + part for part in changed)
        with pytest.raises(InputError, match=fault):
            decode(codec, _framed(magic, body))


@pytest.mark.parametrize(("name", "magic"), [("jpegls", b"PBJL"), ("jpegxl", b"PBJX")])
def test_a_megabyte_may_not_claim_more_pixels_than_seconds_hold(
    name: str, magic: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    codec = _opened(name)
    layout, beams, _, azimuths, _, *_ = _parts(encode_returns(codec, homemade(), "2mm"))
    turns = -(-((1 << 24) + (5 << 20)) // (5 * 16384))
    numbers = b"\1" + base_128(turns) + base_128(16384) * turns
    parts = [layout, beams, numbers, azimuths, bytes(1 << 20)]
    with pytest.raises(InputError, match=r"22\d{6} pixels in"):
        decode(codec, _framed(magic, b"".join(base_128(len(part)) + part for part in parts)))
    monkeypatch.setattr(range_image, "most_points", lambda size: 899)
    with pytest.raises(InputError, match=f"codec {name}: 900 pixels in"):
        encode_returns(codec, homemade(), "2mm")


@pytest.mark.parametrize(("name", "magic"), [("packets_xz", b"PBPX"), ("packets_zstd", b"PBPZ")])
def test_a_megabyte_may_not_claim_more_packets_than_seconds_hold(
    name: str, magic: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = (1 << 15) + (1 << 20) // 64 + 1
    with pytest.raises(InputError, match=f"{count} data packets in 1048576 bytes"):
        decode(_opened(name), _framed(magic, b"\1" + base_128(count) + bytes(1 << 20)))
    monkeypatch.setattr(packets, "_MANY_PACKETS", 0)
    monkeypatch.setattr(packets, "_BYTES_PER_PACKET", 1 << 30)
    with pytest.raises(InputError, match=rf"codec {name}: 150 data packets in \d+ bytes"):
        encode_returns(_opened(name), recorded(), "2mm")


@pytest.mark.parametrize("name", ["puck", "puck_smoothed"])
def test_a_stream_of_turns_without_information_is_refused(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Turns of equal ranges have some hundred bytes, and seconds of work each."""
    ranges = np.full((1, 16384, 1), 500, np.uint16)
    turn = Turn(ranges, np.zeros(16384, np.uint16))
    beams = Beams((1.0,), (0.0,), (0.0,))
    returns = Returns(beams, Layout((0,)), (turn,) * 3, 0.002, "One")
    codec = _opened(name)
    whole = encode_returns(codec, returns, "2mm")
    size = len(whole) - 6 * (name != "puck")  # without the magic of the smoothed one
    most = 3 * (16384 + 1024) - 32 * size
    monkeypatch.setattr(records, "_FEW_RANGES", most)
    assert len(decode_returns(codec, whole).turns) == 3
    monkeypatch.setattr(records, "_FEW_RANGES", most - 1)
    refusal = f"codec {name}: 52224 ranges in {size} bytes"
    with pytest.raises(InputError, match=refusal):
        decode_returns(codec, whole)
    with pytest.raises(InputError, match=refusal):
        encode_returns(codec, returns, "2mm")


def test_the_most_ranges_of_a_stream_grow_with_its_length() -> None:
    """Few bytes may hold 4 Mi ranges, 1 MB at most 6 Mi, each further byte 32."""
    sizes = [0, 100, 1 << 16, (1 << 16) + 1, 1 << 20, (1 << 20) + 1, 1 << 24]
    limits = [records.most_ranges(size) for size in sizes]
    assert limits == sorted(limits)
    assert limits[0] == 1 << 22
    assert limits[2] == limits[3] == limits[4] == 6 << 20
    assert limits[-1] == (6 << 20) + 32 * (15 << 20)
