"""Streams that no encoder makes, crafted with the codecs' own writers: each ends in one error."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pcc_networks.octree_net import stream as octree_stream
from pcc_networks.pcgcv1 import stream as pcgcv1_stream
from pcc_networks.pcgcv2 import stream as pcgcv2_stream
from pcc_networks.reno import stream as reno_stream
from pointkit.errors import InputError
from primitive_codec import hybrid_mode, voxel_mode
from primitive_codec import stream as limits
from primitive_codec.revolution import SPHERE, RevolutionSurface, pack_parameters
from primitive_codec.settings import PrimitiveSettings
from primitive_codec.stream import (
    HybridHeader,
    SurfaceHeader,
    is_decodable,
    pack_hybrid,
    pack_surface,
)
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode, encode, encode_returns
from tests.support.learned_codecs import changes, save_tiny, shell, weights_name
from tests.support.puck_streams import DECODERS, RecordingDecoder
from tests.support.returns import recorded
from tests.support.structured_streams import structured


def _surface(**changed: Any) -> SurfaceHeader:
    header = SurfaceHeader(np.zeros(3), 1.0, (256, 256, 256), 8, 6, 2, 16, 2048, 64)
    return header._replace(**changed)


@pytest.mark.parametrize("bits", [b"", b"\0" * 40, b"\xff" * 40, b"\x11" * 40])
@pytest.mark.parametrize("depth", [11, 12, 14, 16])
def test_a_leaf_of_thousands_of_columns_is_refused(depth: int, bits: bytes) -> None:
    """It once wrote outside the decoder's arrays."""
    side = min(1 << depth, 65535)
    header = _surface(
        shape=(side, min(side, (1 << 26) // side), 1), depth=depth, coarsest_leaf_level=0
    )
    with pytest.raises(InputError, match="its header is invalid"):
        decode(open_codec("primitives"), pack_surface(header, bits))


@pytest.mark.parametrize(
    ("bound", "beyond"),
    [
        ({"depth": 8, "coarsest_leaf_level": 0}, {"depth": 9, "coarsest_leaf_level": 0}),
        ({"coarsest_leaf_level": 6}, {"coarsest_leaf_level": 7}),
        ({"finest_leaf_level": 8}, {"finest_leaf_level": 9}),
        ({"shape": (256, 1, 1)}, {"shape": (257, 1, 1)}),
        ({"shape": (1, 1, 1)}, {"shape": (1, 0, 1)}),
        ({"leaf_capacity": 1 << 20}, {"leaf_capacity": (1 << 20) + 1}),
        ({"point_spacing": 128}, {"point_spacing": 127}),
        ({"plane_step": 1}, {"plane_step": 0}),
        ({"shape": (1 << 13, 1 << 13, 1), "depth": 13, "coarsest_leaf_level": 5},
         {"shape": (1 << 13, (1 << 13) + 1, 1), "depth": 14, "coarsest_leaf_level": 6}),
    ],
)  # fmt: skip
def test_each_field_of_a_surface_has_its_bound(
    bound: dict[str, Any], beyond: dict[str, Any]
) -> None:
    assert is_decodable(_surface(**bound))
    assert not is_decodable(_surface(**beyond))


@pytest.mark.parametrize("side", [(256, 256, 16), (8192, 1024, 1), (65535, 15, 1)])
def test_a_small_stream_cannot_fill_the_whole_grid_of_primitives(
    side: tuple[int, int, int],
) -> None:
    """All-zero bits split every node and occupy every column."""
    depth = int(np.ceil(np.log2(max(side))))
    header = _surface(
        shape=side, depth=depth, finest_leaf_level=depth, coarsest_leaf_level=depth
    )._replace(leaf_capacity=limits.MAX_NODES)
    with pytest.raises(InputError, match="damaged"):
        decode(open_codec("primitives"), pack_surface(header, b"\0" * 30))


def test_voxels_about_the_centre_of_a_sphere_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """1,150 bytes once asked for minutes: the nearest point of a sphere is any of its points."""
    directions = np.random.default_rng(0).normal(size=(20_000, 3))
    sphere = 500 + 400 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    codec = open_codec("primitives")
    surface = encode(codec, sphere, "r3")
    cube = np.stack(np.meshgrid(*[np.arange(20.0)] * 3), axis=-1).reshape(-1, 3)
    factors = np.ones(limits.CLASSES, np.int8)
    monkeypatch.setattr(hybrid_mode, "_MAX_SEARCH_STEPS", 1 << 22)
    for side, is_refused in ((1e-6, True), (0.5, False)):
        place = 500.0 if is_refused else [900.0, 500.0, 500.0]
        voxels = voxel_mode.encode_voxels_of_size(place + cube * side, side)
        stream = pack_hybrid(HybridHeader(8, factors, surface, voxels))
        if is_refused:
            with pytest.raises(InputError, match="too far from its surface"):
                decode(codec, stream)
        else:
            assert len(decode(codec, stream)) >= len(cube)


def test_voxels_about_many_equal_spheres_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plane of as many points hid 255 equal ones, which were searched but not counted."""
    sphere = RevolutionSurface(SPHERE, np.full(3, 100.0), np.eye(3)[2], 3.0, 0.0, -4, 9)
    header = _surface(
        shape=(256, 256, 1), finest_leaf_level=8, coarsest_leaf_level=8, leaf_capacity=1 << 20,
        revolutions=pack_parameters(sphere) * 255,
    )  # fmt: skip
    cube = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
    voxels = voxel_mode.encode_voxels_of_size(100 + cube * 1e-6, 1e-6)
    surface, factors = pack_surface(header, b"\0" * 100), np.ones(limits.CLASSES, np.int8)
    stream = pack_hybrid(HybridHeader(8, factors, surface, voxels))
    codec = open_codec("primitives")
    monkeypatch.setattr(hybrid_mode, "_MAX_SEARCH_STEPS", 1 << 17)  # of 70,000 distinct points
    with pytest.raises(InputError, match="too far from its surface"):
        decode(codec, stream)
    monkeypatch.setattr(hybrid_mode, "_MAX_SEARCH_STEPS", 1 << 20)
    assert len(decode(codec, stream)) >= len(cube)


@pytest.mark.parametrize(
    ("name", "least"), [("MAX_NODES", 1), ("MAX_COLUMNS", 1), ("MAX_CELLS", 8)]
)
def test_what_a_decoder_would_refuse_primitives_codes_as_voxels(
    monkeypatch: pytest.MonkeyPatch, name: str, least: int
) -> None:
    from primitive_codec import surface_mode
    from primitive_codec.preparation import prepare
    from primitive_codec.surface_mode import SurfaceMode, encode_surface

    rng = np.random.default_rng(0)
    cloud = prepare(
        np.column_stack([rng.random((2000, 2)) * 100, np.zeros(2000)]), PrimitiveSettings()
    )
    assert encode_surface(cloud, SurfaceMode()) is not None
    for module in (limits, surface_mode):
        if hasattr(module, name):
            monkeypatch.setattr(module, name, least)
    assert encode_surface(cloud, SurfaceMode()) is None


NETWORKS = ("pcgcv1_plus", "pcgcv2_plus", "sparse_octree_net", "reno", "lizip")


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Codec, bytes]]:
    """Codecs of tiny networks, and a stream of each."""
    examples = {}
    for name in NETWORKS:
        weights = tmp_path_factory.mktemp(name) / weights_name(name)
        save_tiny(name, weights)
        codec = open_codec(name, changes(name, weights))
        examples[name] = (codec, encode(codec, shell(), "r2"))
    return examples


def test_pcgcv1_cannot_promise_cubes_without_bytes(
    learned: dict[str, tuple[Codec, bytes]],
) -> None:
    """A stream of 220 bytes once kept the network busy for 40 s."""
    coded = pcgcv1_stream.read_stream(learned["pcgcv1_plus"][1])
    side, empty = 64, replace(coded, positions=b"", counts=b"", latent=b"", batches=())
    pcgcv1_stream.check_work(replace(empty, cubes=12), side, 2**19)
    with pytest.raises(InputError, match="13 cubes are too many for 0 bytes"):
        pcgcv1_stream.check_work(replace(empty, cubes=13), side, 1)
    with pytest.raises(InputError, match="524289 voxels are too many"):
        pcgcv1_stream.check_work(replace(empty, cubes=12), side, 2**19 + 1)
    pcgcv1_stream.check_work(replace(empty, cubes=13, latent=bytes(32)), side, 1)


def test_pcgcv2_cannot_promise_coarse_voxels_without_bytes(
    learned: dict[str, tuple[Codec, bytes]],
) -> None:
    """A stream of 169 bytes once kept the network busy for 40 s."""
    coded = pcgcv2_stream.read_stream(learned["pcgcv2_plus"][1])
    assert isinstance(coded, pcgcv2_stream.Pcgcv2Stream)
    block = replace(coded.blocks[0], counts=(1, 2**19, 2**17, 2**15))
    with pytest.raises(InputError, match="too many voxels"):
        pcgcv2_stream.write_coded(replace(coded, blocks=(block,)))
    with pytest.raises(InputError, match="too many voxels"):
        pcgcv2_stream.write_coded(replace(coded, blocks=coded.blocks[:1] * 65))


def test_the_octree_net_cannot_promise_parts_without_bytes(
    learned: dict[str, tuple[Codec, bytes]],
) -> None:
    """A stream of 4,327 bytes in 16 parts once kept the network busy for 40 s."""
    coded = octree_stream.read_stream(learned["sparse_octree_net"][1])
    part = replace(coded.parts[0], count=2**21, symbols=bytes(200))
    with pytest.raises(InputError, match="too many voxels for its size"):
        octree_stream.write_stream(replace(coded, parts=(part,) * 16))
    assert octree_stream.max_nodes(replace(part, count=8, symbols=b"")) == 2**17 + 3


def test_reno_cannot_promise_voxels_without_bytes(
    learned: dict[str, tuple[Codec, bytes]],
) -> None:
    coded = reno_stream.read_stream(learned["reno"][1])
    empty = replace(coded.tree, symbols=(b"", b""))
    assert reno_stream.max_nodes(empty) == 2**17
    assert reno_stream.max_nodes(replace(empty, symbols=(bytes(100), b""))) == 2**17 + 1600
    reno_stream.check_work(empty, 2**17)
    with pytest.raises(InputError, match="too many voxels for its size"):
        reno_stream.check_work(empty, 2**17 + 1)
    promise = reno_stream.write_stream(replace(coded, tree=replace(empty, count=2**20 + 1)))
    with pytest.raises(InputError, match="too many voxels for its size"):
        reno_stream.read_stream(promise)


def _endure(codec: Codec | RecordingDecoder, stream: bytes) -> None:
    refused = ""
    try:
        points = decode(codec, stream) if isinstance(codec, Codec) else codec.decode(stream)
        assert np.isfinite(points).all()
    except InputError as error:
        refused = str(error)
    assert "\n" not in refused


@pytest.mark.parametrize("name", ["primitives", "gpcc", "gpcc_angular", "gpcc_predictive"])
def test_structured_streams_end_in_points_or_one_error(name: str) -> None:
    codec = open_codec(name)
    for number in range(60):
        _endure(codec, structured(name, [], number))


@pytest.mark.parametrize("name", NETWORKS)
def test_structured_streams_of_networks_end_in_points_or_one_error(
    name: str, learned: dict[str, tuple[Codec, bytes]]
) -> None:
    codec, stream = learned[name]
    for number in range(40):
        _endure(codec, structured(name, [stream], number))


@pytest.mark.parametrize("name", ["draco", "draco_sequential", "laz", "cloudini"])
def test_structured_streams_of_points_end_in_points_or_one_error(name: str) -> None:
    codec = open_codec(name)
    points = np.cumsum(np.random.default_rng(4).normal(0, 0.02, (800, 3)), axis=0)
    whole = [encode(codec, points, rate) for rate in ("50mm", "2mm")]
    for number in range(40):
        _endure(codec, structured(name, whole, number))


@pytest.mark.parametrize("name", ["jpegls", "jpegxl", "packets_xz", "packets_zstd"])
def test_structured_streams_of_returns_end_in_points_or_one_error(name: str) -> None:
    codec = open_codec(name)
    if why_not_here(codec):
        pytest.skip(why_not_here(codec))
    whole = [encode_returns(codec, recorded(30), "2mm")]
    for number in range(40):
        _endure(codec, structured(name, whole, number))


@pytest.mark.parametrize("name", ["puck (recording)", "puck (bag)"])
def test_structured_recordings_end_in_bytes_or_one_error(name: str) -> None:
    decoder = DECODERS[name]()
    whole = decoder.streams()
    for number in range(20):
        _endure(decoder, structured(name, whole, number))
