import struct

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pointkit.errors import InputError
from puckbench.codecs.registry import codec_of, open_codec
from tests.support.codecs import decode, encode


@pytest.mark.parametrize("bits", range(4, 12))
def test_the_error_is_that_of_a_uniform_quantiser(bits: int) -> None:
    """Mean square of each coordinate is step^2 / 12 with step = extent / (2^bits - 1)."""
    points = np.random.default_rng(2).random((20_000, 3)) * 1023
    points[:2] = [[0, 0, 0], [1023, 1023, 1023]]
    codec = open_codec("draco")
    decoded = decode(codec, encode(codec, points, f"r{bits - 3}"))
    step = 1023 / (2**bits - 1)
    on_grid = np.round(points / step) * step
    assert len(decoded) == len(points)
    cells = [
        {tuple(row) for row in np.round(cloud / step).astype(int)} for cloud in (decoded, on_grid)
    ]
    apart = len(cells[0] ^ cells[1]) / len(points)  # single precision moves a few over a border
    assert apart < 0.002
    assert np.abs(decoded / step - np.round(decoded / step)).max() < 1e-3
    assert np.mean((on_grid - points) ** 2) == pytest.approx(step**2 / 12, rel=0.05)


def test_the_kd_tree_coder_is_used() -> None:
    stream = encode(open_codec("draco"), np.random.default_rng(0).random((100, 3)), "r8")
    assert stream[:5] == b"DRACO"
    assert stream[7:9] == b"\x00\x01"  # a point cloud, kd-tree method


def test_equal_points_are_coded_once_and_merged_ones_are_kept() -> None:
    codec = open_codec("draco")
    line = np.column_stack([np.arange(1000.0), np.zeros(1000), np.zeros(1000)])
    decoded = decode(codec, encode(codec, np.vstack([line, line]), "r1"))
    assert len(decoded) == 1000
    assert len(np.unique(decoded, axis=0)) == 16


def test_a_header_that_claims_too_many_points_is_refused_at_once() -> None:
    codec = open_codec("draco")
    stream = bytearray(encode(codec, np.random.default_rng(0).random((100, 3)), "r1"))
    struct.pack_into("<I", stream, 11, 2_000_000_000)
    with pytest.raises(InputError, match="claims 2000000000 points"):
        decode(codec, bytes(stream))


@pytest.mark.parametrize(
    ("stream", "fault"),
    [
        (b"", "truncated"),
        (b"DRACO\x02", "truncated"),
        (b"ply\nformat ascii 1.0", "not a Draco point-cloud"),
        (b"DRACO\x02\x02\x01\x01\x00\x00" + bytes(40), "not a Draco point-cloud"),
    ],
    ids=["empty", "cut", "foreign", "mesh"],
)
def test_foreign_streams_are_refused(stream: bytes, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        decode(open_codec("draco"), stream)


def test_coordinates_beyond_single_precision_are_refused() -> None:
    with pytest.raises(InputError, match="single precision"):
        encode(open_codec("draco"), np.array([[1e39, 0, 0], [0, 0, 0]]), "r1")


@pytest.mark.parametrize("name", ["draco", "draco_sequential"])
@pytest.mark.parametrize("far", [0.0, 1e6])
@pytest.mark.parametrize(
    ("rate", "width", "most"),
    [("1mm", 500, 0.625), ("1mm", 1000, 0.5), ("1mm", 60_000, 0.5), ("10mm", 200_000, 0.5)],
)
def test_errors_at_a_length_do_not_grow_with_the_width(
    name: str, rate: str, width: float, most: float, far: float
) -> None:
    codec = open_codec(name)
    points = np.random.default_rng(0).random((3000, 3)) * [width, width, 100] + far
    stream = encode(codec, points, rate)
    assert stream == encode(codec, points, rate)
    assert codec_of(stream) == "draco"
    decoded = decode(codec, stream)
    if name == "draco":  # its order is the tree's
        decoded = decoded[cKDTree(decoded).query(points)[1]]
    assert np.abs(decoded - points).max() <= most * int(rate[:-2]) / 1000 + 1e-9


def test_only_the_sequential_method_keeps_equal_positions_of_a_wide_cloud() -> None:
    points = np.repeat(np.random.default_rng(0).random((50, 3)) * 5000, 2, axis=0)
    points[1::2] += 1e-5
    counts = [
        len(decode(codec, encode(codec, points, "1mm")))
        for codec in map(open_codec, ("draco", "draco_sequential"))
    ]
    assert counts == [50, 100]
