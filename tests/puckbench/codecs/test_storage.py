"""What points are stored in today: each stream is read by another program than wrote it."""

import hashlib
import struct
from io import BytesIO

import laspy
import numpy as np
import pytest
from pureini import EncodingInfo, FieldType, PointcloudDecoder, PointcloudEncoder, PointField

from pointkit.coding.byte_io import Reader
from pointkit.coding.zstandard import compressed, decompressed
from pointkit.errors import InputError
from puckbench.codecs import most_points
from puckbench.codecs.rates import metric_rates
from puckbench.codecs.registry import codec_of, open_codec
from tests.support.codecs import decode, encode

NAMES = ("laz", "cloudini", "draco_sequential")
CLOUDINI_POINTS = np.cumsum(np.random.default_rng(1).integers(-99, 100, (40_000, 3)), axis=0) / 1000
CLOUDINI_SHA256 = "f0e0d5e3b189c39ea10f165f5e51630d357897f666727da16f728d4de01b1d21"
"""Of the stream that Cloudini's C++ library (commit d202e52, version 5, 10 mm) writes for them."""


def _points() -> np.ndarray:
    """A random walk in a room, some points of which come twice."""
    points = np.cumsum(np.random.default_rng(4).normal(0, 0.02, (800, 3)), axis=0)
    return np.repeat(points, 1 + (np.arange(800) % 5 == 0), axis=0)


@pytest.mark.parametrize("name", NAMES)
def test_every_point_stays_in_its_place_within_half_a_step(name: str) -> None:
    codec, points = open_codec(name), _points()
    for rate, parameters in metric_rates(codec.rates).items():
        decoded = decode(codec, encode(codec, points, rate))
        assert decoded.shape == points.shape
        assert np.abs(decoded - points).max() <= parameters["step_m"] / 2 + 1e-6


def test_laspy_reads_the_points_of_laz() -> None:
    points = _points()
    stream = encode(open_codec("laz"), points, "5mm")
    las = laspy.read(BytesIO(stream))
    np.testing.assert_allclose(las.xyz, np.rint(points / 0.005) * 0.005, atol=1e-12)
    assert las.header.scales.tolist() == [0.005] * 3


def test_laz_of_several_chunks_comes_back() -> None:
    points = np.random.default_rng(1).integers(0, 1000, (120_000, 3)) * 0.01
    decoded = decode(open_codec("laz"), encode(open_codec("laz"), points, "10mm"))
    np.testing.assert_allclose(decoded, points, atol=1e-9)


def test_pureini_alone_reads_the_points_of_cloudini() -> None:
    points = _points()
    data, info = PointcloudDecoder().decode(encode(open_codec("cloudini"), points, "5mm"))
    assert [field.name for field in info.fields] == ["x", "y", "z"]
    assert np.abs(np.frombuffer(data).reshape(-1, 3) - points).max() <= 0.0025 * (1 + 1e-6)


def test_cloudini_has_the_bytes_of_its_authors_library() -> None:
    stream = encode(open_codec("cloudini"), CLOUDINI_POINTS, "10mm")
    assert hashlib.sha256(stream).hexdigest() == CLOUDINI_SHA256


def test_differences_of_cloudini_are_those_of_plain_python() -> None:
    """Zigzag numbers, base 128, from 1 (0 is no number), in chunks of 2^15 points, Zstandard."""
    points = CLOUDINI_POINTS
    stream = encode(open_codec("cloudini"), points, "10mm")
    chunks, positions = Reader(stream[stream.index(b"\0") + 1 :]), []
    for count in (1 << 15, 40_000 - (1 << 15)):
        frame = chunks.take(int.from_bytes(chunks.take(4), "little"))
        numbers, at = Reader(decompressed(frame, 10**6)), [0, 0, 0]
        for _ in range(count):
            codes = [numbers.number() - 1 for _ in at]
            at = [place + (code >> 1 ^ -(code & 1)) for place, code in zip(at, codes, strict=True)]
            positions.append(at)
        assert numbers.rest() == b""
    assert chunks.rest() == b""
    assert np.abs(np.array(positions) - points / 0.01).max() <= 0.5 + 1e-4


def test_draco_keeps_order_by_its_sequential_method() -> None:
    points = _points()
    stream = encode(open_codec("draco_sequential"), points, "2mm")
    assert stream[7:9] == b"\x00\x00"  # a point cloud, sequential method
    assert codec_of(stream) == "draco"
    np.testing.assert_array_equal(
        decode(open_codec("draco"), stream), decode(open_codec("draco_sequential"), stream)
    )


def test_zstandard_unpacks_no_more_than_it_is_told() -> None:
    data = bytes(10**6)
    stream = compressed(data, long=True)
    assert decompressed(stream, len(data)) == data
    for wrong, most in ((stream, len(data) - 1), (stream + b"\0", len(data)), (stream[:-1], 10**7)):
        with pytest.raises(InputError, match="damaged"):
            decompressed(wrong, most)


def test_a_stream_that_claims_too_many_points_is_refused_at_once() -> None:
    stream = bytearray(encode(open_codec("laz"), _points(), "5mm"))
    struct.pack_into("<I", stream, 107, 2**31)
    with pytest.raises(InputError, match="2147483648 points in"):
        decode(open_codec("laz"), bytes(stream))
    stream = encode(open_codec("cloudini"), _points(), "5mm").replace(
        b"width: 960", b"width: 900000000"
    )
    with pytest.raises(InputError, match="900000000 points in"):
        decode(open_codec("cloudini"), stream)


@pytest.mark.parametrize("name", NAMES[:2])
def test_clouds_beyond_32_bits_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"codec {name}: the cloud reaches beyond"):
        encode(open_codec(name), np.array([[0.0, 0, 0], [3e6, 0, 0]]), "1mm")


def test_other_peoples_cloudini_is_refused_in_one_line() -> None:
    stream = encode(open_codec("cloudini"), _points(), "5mm")
    single = [PointField(axis, 4 * k, FieldType.FLOAT32, 0.005) for k, axis in enumerate("xyz")]
    others = PointcloudEncoder(EncodingInfo(single, 960, point_step=12)).encode(bytes(960 * 12))
    for wrong in (others, stream[:40], stream.replace(b"width: 960", b"width: 961"), stream + b"1"):
        with pytest.raises(InputError, match=r"not Cloudini's format as puckbench|damaged"):
            decode(open_codec("cloudini"), wrong)


def test_other_peoples_laz_is_refused_in_one_line() -> None:
    las = laspy.create(point_format=3, file_version="1.4")
    las.x = las.y = las.z = np.arange(10.0)
    packed = BytesIO()
    las.write(packed, do_compress=True)
    with pytest.raises(InputError, match="not LAZ as puckbench writes it"):
        decode(open_codec("laz"), packed.getvalue())


@pytest.mark.parametrize("name", ["draco", "draco_sequential", "laz", "cloudini"])
def test_a_megabyte_may_not_claim_more_points_than_seconds_hold(name: str) -> None:
    """A hundred kilobytes of Draco once might claim 800 million points."""
    codec = open_codec(name)
    stream, most = bytearray(encode(codec, _points(), "5mm")), (1 << 24) + (4 << 20)
    filler = bytes(1 << 20)
    if name == "cloudini":
        forged = stream.replace(b"width: 960", b"width: %d" % (most + (1 << 16))) + filler
    else:
        struct.pack_into("<I", stream, 107 if name == "laz" else 11, most + (1 << 16))
        forged = stream + filler
    with pytest.raises(InputError, match=r"claims \d{8} points|\d{8} points in"):
        decode(codec, bytes(forged))


@pytest.mark.parametrize("name", ["draco", "draco_sequential", "laz", "cloudini"])
def test_more_points_than_a_decoder_takes_are_not_coded(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(most_points, "_MANY", 10)
    monkeypatch.setattr(most_points, "_MANY_PER_BYTE", 0)
    with pytest.raises(InputError, match=f"codec {name}: .*points"):
        encode(open_codec(name), _points(), "5mm")


@pytest.mark.parametrize("name", ["draco", *NAMES])
@pytest.mark.parametrize("rate", ["10mm", "5mm", "2mm"])
def test_wide_clouds_far_away_keep_their_step(name: str, rate: str) -> None:
    """Ten kilometres at 530 km: Draco's single precision has steps of 31 mm there."""
    points = np.random.default_rng(2).random((500, 3)) * [1e4, 1e4, 50] + [531e3, 140e3, 10]
    codec = open_codec(name)
    decoded = decode(codec, encode(codec, points, rate))
    for axis in range(3):
        outputs, inputs = np.sort(decoded[:, axis]), np.sort(points[:, axis])
        single = 0.002  # two steps of single precision at ten kilometres
        assert np.abs(outputs - inputs).max() <= codec.rates[rate]["step_m"] / 2 + single
