"""Bounds of G-PCC's streams: what an encoder refuses, a decoder refuses, and just that."""

import numpy as np
import pytest

from gpcc import coder, syntax
from gpcc.coder import PROFILES, decode_geometry, encode_geometry
from gpcc.lossless import decode_voxels, encode_voxels
from pointkit.coding.byte_io import base_128
from pointkit.errors import InputError


def _bare(corner: int = 0) -> tuple[bytes, bytes]:
    """Parameter sets, and one slice of a point."""
    stream = encode_geometry(np.full((1, 3), corner), PROFILES["ctc"])
    units = [syntax.encapsulate(*unit) for unit in syntax.payloads(stream)]
    return b"".join(units[:-1]), units[-1]


def test_slices_have_a_bound_on_their_levels() -> None:
    """40,000 slices of a point each once took 39 s."""
    head, unit = _bare()
    assert len(decode_geometry(head + unit * 1000).points) == 1000
    with pytest.raises(InputError, match="more than 16384 octree levels"):
        decode_geometry(head + unit * 40_000)


def test_an_encoder_refuses_slices_that_a_decoder_would(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(0).integers(0, 1000, (200, 3))
    options = PROFILES["ctc"].model_copy(update={"slice_max_points": 20})
    stream = encode_geometry(points, options)
    monkeypatch.setattr(coder, "MAX_LEVELS", 1)
    with pytest.raises(InputError, match="more than 1 octree levels"):
        encode_geometry(points, options)
    with pytest.raises(InputError, match="more than 1 octree levels"):
        decode_geometry(stream)


def test_parameter_sets_have_a_bound() -> None:
    head, unit = _bare()
    inventory = syntax.encapsulate(syntax.TILE_INVENTORY, b"\0" * 4)
    spare = coder.MAX_PARAMETER_BYTES - sum(len(unit) for kind, unit in syntax.payloads(head))
    assert len(decode_geometry(head + inventory * (spare // 4) + unit).points) == 1
    with pytest.raises(InputError, match="parameter bytes"):
        decode_geometry(head + inventory * (spare // 4 + 1) + unit)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_largest_origin_of_a_sequence_is_just_below_2_to_the_31(sign: int) -> None:
    most = (1 << 31) - 1
    stream = encode_geometry(np.zeros((1, 3), int), PROFILES["minimal"], 1, (0, sign * most, 0))
    assert decode_geometry(stream).origin == (0, sign * most, 0)
    with pytest.raises(InputError, match="origin"):
        encode_geometry(np.zeros((1, 3), int), PROFILES["minimal"], 1, (0, sign * (most + 1), 0))


@pytest.mark.parametrize(("origin", "fits"), [((1 << 31) - 1, True), (1 << 31, False)])
def test_origins_are_bounded_in_decoders_too(origin: int, fits: bool) -> None:
    sps = syntax.SequenceParameterSet(seq_origin_bits=32, seq_origin_xyz=(0, -origin, 0))
    written = syntax.written(syntax.sequence_parameter_set, sps)
    head, unit = _bare()
    units = list(syntax.payloads(head))
    stream = syntax.encapsulate(0, written) + syntax.encapsulate(*units[1]) + unit
    if fits:
        assert decode_geometry(stream).origin == (0, -origin, 0)
    else:
        with pytest.raises(InputError, match="the origin is too large"):
            decode_geometry(stream)


def test_voxels_are_21_bits_apart_at_most() -> None:
    ends = np.array([[0, 0, 0], [0, (1 << 21) - 1, 0]])
    packed = encode_voxels(ends)
    assert np.array_equal(np.sort(decode_voxels(packed), axis=0), ends)
    with pytest.raises(InputError, match="more than 21 bits apart"):
        encode_voxels(ends + np.array([[0, 0, 0], [0, 1, 0]]))
    bits = packed.index(base_128(21 << 5), 3)  # after the corner and the number of voxels
    beyond = packed[:bits] + base_128(22 << 5) + packed[bits + len(base_128(21 << 5)) :]
    with pytest.raises(InputError, match="header is damaged"):
        decode_voxels(beyond)


def test_no_more_voxels_are_decoded_than_a_codec_takes() -> None:
    packed = encode_voxels(np.arange(30).reshape(-1, 3))
    assert len(decode_voxels(packed, 10)) == 10
    with pytest.raises(InputError, match="header is damaged"):
        decode_voxels(packed, 9)


@pytest.mark.parametrize(
    ("points", "fault"),
    [
        (np.zeros((0, 3), int), "no points to code"),
        (np.zeros((4, 2), int), r"shape \(n, 3\), got \(4, 2\)"),
        (np.full((4, 3), 0.5), "are not integers"),
        (np.full((4, 3), np.nan), "are not integers"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_what_are_no_grid_points_is_refused(points: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        encode_geometry(points, PROFILES["ctc"])


def test_points_on_both_sides_of_the_origin_come_back() -> None:
    points = np.random.default_rng(0).integers(-50, 500, (200, 3))
    result = decode_geometry(encode_geometry(points, PROFILES["ctc"])).positions()
    assert sorted(result.tolist()) == sorted(points.astype(float).tolist())
