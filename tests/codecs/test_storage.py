"""What points are stored in today: each stream is read by another program than wrote it."""

import struct
import zlib
from io import BytesIO

import laspy
import numpy as np
import pytest

from puckbench.codecs.registry import codec_of, open_codec
from puckbench.coding import most_points
from puckbench.coding.byte_io import Reader, base_128, signed_128
from puckbench.coding.varints import packed_signed, unpacked_signed
from puckbench.coding.zstandard import compressed, decompressed
from puckbench.core.errors import InputError

NAMES = ("laz", "delta_zstd", "draco_sequential")


def _points() -> np.ndarray:
    """A random walk in a room, some points of which come twice."""
    points = np.cumsum(np.random.default_rng(4).normal(0, 0.02, (800, 3)), axis=0)
    return np.repeat(points, 1 + (np.arange(800) % 5 == 0), axis=0)


@pytest.mark.parametrize("name", NAMES)
def test_every_point_stays_in_its_place_within_half_a_step(name: str) -> None:
    codec, points = open_codec(name), _points()
    for rate, parameters in codec.metric_rates.items():
        decoded = codec.decode(codec.encode(points, rate))
        assert decoded.shape == points.shape
        assert np.abs(decoded - points).max() <= parameters["step_m"] / 2 + 1e-6


def test_laspy_reads_the_points_of_laz() -> None:
    points = _points()
    stream = open_codec("laz").encode(points, "5mm")
    found = laspy.read(BytesIO(stream))
    np.testing.assert_allclose(found.xyz, np.rint(points / 0.005) * 0.005, atol=1e-12)
    assert found.header.scales.tolist() == [0.005] * 3


def test_laz_of_several_chunks_comes_back() -> None:
    points = np.random.default_rng(1).integers(0, 1000, (120_000, 3)) * 0.01
    decoded = open_codec("laz").decode(open_codec("laz").encode(points, "10mm"))
    np.testing.assert_allclose(decoded, points, atol=1e-9)


def test_differences_are_those_of_plain_python() -> None:
    points = _points()
    stream = open_codec("delta_zstd").encode(points, "10mm")
    reader = Reader(stream[9:])
    assert struct.unpack("<d", reader.take(8)) == (0.01,)
    count = reader.number()
    numbers = Reader(decompressed(reader.rest(), 10**6))
    at, found = [0, 0, 0], []
    for _ in range(count):
        at = [place + numbers.signed() for place in at]
        found.append(at)
    assert numbers.rest() == b""
    np.testing.assert_array_equal(found, np.rint(points / 0.01))


def test_draco_keeps_order_by_its_sequential_method() -> None:
    points = _points()
    stream = open_codec("draco_sequential").encode(points, "2mm")
    assert stream[7:9] == b"\x00\x00"  # a point cloud, sequential method
    assert codec_of(stream) == "draco"
    np.testing.assert_array_equal(
        open_codec("draco").decode(stream), open_codec("draco_sequential").decode(stream)
    )


def test_arrays_of_numbers_are_coded_as_numbers_one_by_one() -> None:
    numbers = np.array([0, -1, 1, 63, -64, 64, 8191, -8192, 8192, 2**33, -(2**34), 2**34 - 1])
    data = packed_signed(numbers)
    assert data == b"".join(signed_128(int(number)) for number in numbers)
    np.testing.assert_array_equal(unpacked_signed(data, len(numbers)), numbers)
    for wrong in (data[:-1], data + b"\0", b"\x80" * 5 + data[1:]):
        with pytest.raises(InputError, match="damaged"):
            unpacked_signed(wrong, len(numbers))


def test_zstandard_unpacks_no_more_than_it_is_told() -> None:
    data = bytes(10**6)
    stream = compressed(data, long=True)
    assert decompressed(stream, len(data)) == data
    for wrong, most in ((stream, len(data) - 1), (stream + b"\0", len(data)), (stream[:-1], 10**7)):
        with pytest.raises(InputError, match="damaged"):
            decompressed(wrong, most)


def test_a_stream_that_claims_too_many_points_is_refused_at_once() -> None:
    stream = bytearray(open_codec("laz").encode(_points(), "5mm"))
    struct.pack_into("<I", stream, 107, 2**31)
    with pytest.raises(InputError, match="2147483648 points in"):
        open_codec("laz").decode(bytes(stream))
    body = struct.pack("<d", 0.01) + base_128(2**31) + compressed(bytes(100))
    forged = b"PBDZ\x01" + struct.pack("<I", zlib.crc32(body)) + body
    with pytest.raises(InputError, match="2147483648 points in"):
        open_codec("delta_zstd").decode(forged)


@pytest.mark.parametrize("name", NAMES[:2])
def test_clouds_beyond_32_bits_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"codec {name}: the cloud reaches beyond"):
        open_codec(name).encode(np.array([[0.0, 0, 0], [3e6, 0, 0]]), "1mm")


def test_other_peoples_laz_is_refused_in_one_line() -> None:
    las = laspy.create(point_format=3, file_version="1.4")
    las.x = las.y = las.z = np.arange(10.0)
    packed = BytesIO()
    las.write(packed, do_compress=True)
    with pytest.raises(InputError, match="not LAZ as puckbench writes it"):
        open_codec("laz").decode(packed.getvalue())


@pytest.mark.parametrize("name", ["draco", "draco_sequential", "laz", "delta_zstd"])
def test_a_megabyte_may_not_claim_more_points_than_seconds_hold(name: str) -> None:
    """A hundred kilobytes of Draco once might claim 800 million points."""
    codec = open_codec(name)
    stream, most = bytearray(codec.encode(_points(), "5mm")), (1 << 24) + (4 << 20)
    filler = bytes(1 << 20)
    if name == "delta_zstd":
        body = struct.pack("<d", 0.01) + base_128(most + 17) + filler
        forged = b"PBDZ\x01" + struct.pack("<I", zlib.crc32(body)) + body
    else:
        struct.pack_into("<I", stream, 107 if name == "laz" else 11, most + (1 << 16))
        forged = bytes(stream) + filler
    with pytest.raises(InputError, match=r"claims \d{8} points|\d{8} points in"):
        codec.decode(forged)


@pytest.mark.parametrize("name", ["draco", "draco_sequential", "laz", "delta_zstd"])
def test_more_points_than_a_decoder_takes_are_not_coded(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(most_points, "_MANY", 10)
    monkeypatch.setattr(most_points, "_MANY_PER_BYTE", 0)
    with pytest.raises(InputError, match=f"codec {name}: .*points"):
        open_codec(name).encode(_points(), "5mm")


@pytest.mark.parametrize("name", ["draco", *NAMES])
@pytest.mark.parametrize("rate", ["10mm", "5mm", "2mm"])
def test_wide_clouds_far_away_keep_their_step(name: str, rate: str) -> None:
    """Ten kilometres at 530 km: Draco's single precision has steps of 31 mm there."""
    points = np.random.default_rng(2).random((500, 3)) * [1e4, 1e4, 50] + [531e3, 140e3, 10]
    codec = open_codec(name)
    decoded = codec.decode(codec.encode(points, rate))
    for axis in range(3):
        found, given = np.sort(decoded[:, axis]), np.sort(points[:, axis])
        single = 0.002  # two steps of single precision at ten kilometres
        assert np.abs(found - given).max() <= codec.metric_rates[rate]["step_m"] / 2 + single
