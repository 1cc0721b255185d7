"""Attributes: streams of the reference software, round trips, damage."""

import hashlib
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcc import syntax
from gpcc.attributes.cloud import decode_cloud, encode_cloud
from gpcc.attributes.colours import BT709, YCGCO, coded_colours, decoded_colours
from gpcc.attributes.geometry import SlicePoints
from gpcc.attributes.neighbour_search import boxes
from gpcc.attributes.options import ATTRIBUTE_PROFILES, AttributeOptions
from gpcc.attributes.reader import AttributeReader
from gpcc.attributes.syntax import (
    RAW,
    AttributeHeader,
    AttributeParameterSet,
    attribute_header,
    attribute_parameter_set,
)
from gpcc.bits import BitReader
from gpcc.coder import decode_geometry
from gpcc.conformance import decode_rows
from gpcc.options import GpccOptions
from pointkit.errors import InputError
from pointkit.files import read_json
from tests.gpcc.attribute_vectors import (
    FOLDER,
    OURS,
    SENSOR,
    VECTORS,
    colours,
    points,
    reflectances,
)

MANIFEST: dict[str, dict[str, Any]] = read_json(FOLDER / "manifest.json")
POINTS = points()


def _stream(name: str) -> bytes:
    return (FOLDER / f"{name}.bin").read_bytes()


@pytest.mark.parametrize("name", VECTORS)
def test_a_stream_decodes_to_what_tmc13_decodes_in_its_order(name: str) -> None:
    rows = decode_rows(_stream(name)).astype("<f8")
    assert hashlib.sha256(rows.tobytes()).hexdigest() == MANIFEST[name]["sha256_float64"]


@pytest.mark.parametrize("name", VECTORS)
def test_our_stream_is_that_of_tmc13_byte_for_byte(name: str) -> None:
    options, attributes = OURS[name]
    values = {"color": colours(POINTS), "reflectance": reflectances(POINTS)}
    low = POINTS.min(axis=0)
    ours = encode_cloud(
        POINTS - low,
        {attribute: values[attribute] for attribute in attributes},
        options,
        attributes,
        origin=low,
        sensor=SENSOR if VECTORS[name][0] == "angular" else None,
    )
    assert list(syntax.payloads(ours)) == list(syntax.payloads(_stream(name)))


def test_geometry_alone_does_not_need_the_attributes() -> None:
    stream = _stream("both")
    units = [(k, p) for k, p in syntax.payloads(stream) if k != syntax.ATTRIBUTE_DATA_UNIT]
    bare = b"".join(syntax.encapsulate(kind, payload) for kind, payload in units)
    assert (decode_geometry(stream).points == decode_cloud(stream).points).all()
    assert (decode_cloud(bare).attributes["color"] == 255).any(axis=1).all()  # the middle of YCgCo


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_lossless_attributes_come_back(data: st.DataObject) -> None:
    random = np.random.default_rng(data.draw(st.integers(0, 1 << 30)))
    count = data.draw(st.integers(1, 60))
    bits = data.draw(st.integers(1, 16))
    cloud = random.integers(0, data.draw(st.sampled_from([2, 9, 3000])), (count, 3))
    values = random.integers(0, 1 << bits, count)
    levels = data.draw(st.sampled_from([0, 1, 5]))
    options = AttributeOptions(
        bitdepth=bits,
        level_of_detail_count=levels,
        lod_decimator=data.draw(st.sampled_from(["distance", "periodic", "centroid"])),
        intra_lod_prediction_skip_layers=0,
        adaptive_prediction_threshold=data.draw(st.integers(0, 255)),
        max_num_direct_predictors=data.draw(st.integers(0, 3)),
        direct_avg_predictor_disabled=data.draw(st.booleans()),
        canonical_point_order=levels == 0 and data.draw(st.booleans()),
    )
    stream = encode_cloud(
        cloud,
        {"reflectance": values},
        GpccOptions(merge_duplicates=False),
        {"reflectance": options},
    )
    decoded = decode_cloud(stream)
    rows = np.column_stack([cloud, values])
    result = np.column_stack([decoded.positions(), decoded.attributes["reflectance"]])
    assert sorted(map(tuple, result.tolist())) == sorted(map(tuple, rows.tolist()))


def test_slices_and_merged_points_keep_the_values_of_constant_attributes() -> None:
    cloud = np.random.default_rng(0).integers(0, 12, (900, 3))
    options = GpccOptions(slice_max_points=200)
    stream = encode_cloud(cloud, {"color": np.full((900, 3), (200, 40, 90))}, options, {
        "color": AttributeOptions(colour_matrix="identity")
    })  # fmt: skip
    decoded = decode_cloud(stream)
    assert len(decoded.points) == len(np.unique(cloud, axis=0))
    assert (decoded.attributes["color"] == (200, 40, 90)).all()


@pytest.mark.parametrize("transform", ["predicting", "lifting", "raht"])
def test_slices_in_threads_give_the_bytes_and_order_of_one_thread(
    transform: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = GpccOptions(slice_max_points=200, merge_duplicates=False)
    values = {"reflectance": reflectances(POINTS)}
    chosen = {"reflectance": AttributeOptions(transform=transform)}
    results = []
    for threads in ("1", "4"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        stream = encode_cloud(POINTS, values, options, chosen)
        decoded = decode_cloud(stream)
        results.append(
            (stream, decoded.points.tolist(), decoded.attributes["reflectance"].tolist())
        )
    assert results[0] == results[1]


@pytest.mark.parametrize("side", [300, 1 << 18])
@pytest.mark.parametrize("profile", ["lossless", "lossless_lidar", "lifting_lidar", "raht"])
def test_a_slice_in_threads_gives_the_bytes_and_values_of_one_thread(
    profile: str, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    cloud = np.random.default_rng(4).integers(0, side, (40_000, 3))
    cloud[20_000:] //= 64  # dense, so that sparse blocks of cells precede those of other threads
    values = {"reflectance": cloud.sum(axis=1) % 256}
    options, chosen = GpccOptions(merge_duplicates=False), ATTRIBUTE_PROFILES[profile]
    results = []
    for threads in ("1", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        stream = encode_cloud(cloud, values, options, {"reflectance": chosen})
        results.append((stream, decode_cloud(stream).attributes["reflectance"].tolist()))
    assert results[0] == results[1]


@pytest.mark.parametrize("place", [1, 2], ids=["after its first use", "after a later slice"])
def test_a_parameter_set_must_precede_its_use(place: int) -> None:
    """Slices are decoded at the end of the stream, with the parameter sets that preceded them."""
    options = GpccOptions(slice_max_points=200, merge_duplicates=False)
    stream = encode_cloud(POINTS, {"reflectance": reflectances(POINTS)}, options)
    units = list(syntax.payloads(stream))
    (late,) = [unit for unit in units if unit[0] == syntax.ATTRIBUTE_PARAMETER_SET]
    uses = [k for k, unit in enumerate(units) if unit[0] == syntax.ATTRIBUTE_DATA_UNIT]
    units.insert(uses[place - 1] + 1, late)
    units.remove(late)
    with pytest.raises(InputError, match="without a parameter set"):
        decode_cloud(b"".join(syntax.encapsulate(*unit) for unit in units))


def test_coordinates_of_a_sensor_that_is_not_there_are_refused() -> None:
    trees = syntax.GeometryParameterSet(geom_tree_type=syntax.PREDICTIVE)
    cloud, none = POINTS.astype(np.int32), np.empty((0, 3), np.int32)
    points = SlicePoints(trees, (0, 1, 2), (0, 0, 0), cloud, spherical=none)
    aps = AttributeParameterSet(spherical_coord_flag=1, attr_coord_scale=[256, 256, 256])
    with pytest.raises(InputError, match="without a sensor"):
        points.coordinates(aps)


def test_values_without_compression_need_little_memory() -> None:
    """Bits as integers of 8 bytes once took 20 times that of the values."""
    values = np.random.default_rng(0).integers(0, 1 << 11, 200_000)
    sps = syntax.SequenceParameterSet(attributes=[syntax.AttributeDescription(0, 0, 10, 1)])
    gps, aps = syntax.GeometryParameterSet(), AttributeParameterSet(attr_encoding=RAW)
    bits = (values[:, None] >> np.arange(11)[::-1] & 1).astype(np.uint8)
    unit = syntax.written(attribute_header, AttributeHeader(), aps, sps.attributes)
    unit += np.packbits(bits).tobytes()
    points = SlicePoints(gps, (0, 1, 2), (0, 0, 0), np.zeros((len(values), 3), np.int32))
    reader = AttributeReader()
    reader.take(syntax.ATTRIBUTE_PARAMETER_SET, syntax.written(attribute_parameter_set, aps))
    reader.start_slice(sps, syntax.GeometryHeader(), points)
    tracemalloc.start()
    reader.take(syntax.ATTRIBUTE_DATA_UNIT, unit)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64 * len(values)
    assert (reader.attributes(converted=True)["reflectance"] == values).all()


@pytest.mark.parametrize(
    ("transform", "pairs", "factors"),
    [("predicting", [(8, 2), (0, 0), (0, 0), (0, 0)], []), ("lifting", [], [6, 6, 6, 6])],
)
def test_factors_after_a_level_without_points_are_those_of_tmc13(
    transform: Any, pairs: list[tuple[int, int]], factors: list[int]
) -> None:
    """One of six points is in the coarsest level, and the others are in the finest of four."""
    numbers = np.arange(6)[:, None]
    options = AttributeOptions(
        transform=transform,
        colour_matrix="identity",
        level_of_detail_count=3,
        lod_decimator="periodic",
        lod_sampling_period=(7, 2, 2),
        intra_lod_prediction_skip_layers=0,
        inter_component_prediction=True,
    )
    values = {"color": (10, 20, 40) + numbers * (30, 24, 9)}
    stream = encode_cloud(numbers * (5, 9, 3), values, attribute_options={"color": options})
    units = dict(syntax.payloads(stream))
    sps, aps, header = syntax.SequenceParameterSet(), AttributeParameterSet(), AttributeHeader()
    syntax.sequence_parameter_set(BitReader(units[syntax.SEQUENCE_PARAMETER_SET]), sps)
    attribute_parameter_set(BitReader(units[syntax.ATTRIBUTE_PARAMETER_SET]), aps)
    reader = BitReader(units[syntax.ATTRIBUTE_DATA_UNIT])
    attribute_header(reader, header, aps, sps.attributes)
    assert (header.inter_component_coeffs, header.last_component_coeffs) == (pairs, factors)


def test_colour_conversions() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(0, 256, 15)] * 3), axis=-1).reshape(-1, 3)
    grid = grid.astype(np.int32)
    assert (decoded_colours(coded_colours(grid, YCGCO, 9), YCGCO, 9) == grid).all()
    assert abs(decoded_colours(coded_colours(grid, BT709, 8), BT709, 8) - grid).max() <= 2
    white = np.array([[255, 255, 255]], dtype=np.int32)
    assert coded_colours(white, BT709, 8).tolist() == [[255, 128, 128]]


def test_boxes_bound_their_positions() -> None:
    cloud = np.random.default_rng(1).integers(-99, 99, (1000, 3)).astype(np.int32)
    around = boxes(cloud)
    for level, start in enumerate(around.starts[1:].tolist(), 1):
        for k in range(-(-len(cloud) >> 3 * level)):
            inside = cloud[k << 3 * level : (k + 1) << 3 * level]
            expected = [*inside.min(axis=0), *inside.max(axis=0)]
            assert around.boxes[start + k].tolist() == expected


@pytest.mark.parametrize("name", ["nearest", "both", "lifting_colours", "raht"])
def test_damaged_streams_are_refused_or_decoded(name: str) -> None:
    stream = _stream(name)
    start = stream.index(next(p for k, p in syntax.payloads(stream) if k == 3))
    random = np.random.default_rng(3)
    for _ in range(60):
        broken = bytearray(stream)
        for place in random.integers(start, len(stream), random.integers(1, 4)):
            broken[place] = random.integers(256)
        try:
            decoded = decode_cloud(bytes(broken))
        except InputError:
            continue
        assert all(len(v) == len(decoded.points) for v in decoded.attributes.values())


@pytest.mark.parametrize(
    ("attributes", "options", "said"),
    [
        (
            {"reflectance": np.arange(800)},
            {"reflectance": AttributeOptions(bitdepth=12, attr_offset=7, attr_scale=3)},
            "12 bits after attr_scale, or below attr_offset",
        ),
        ({"normal": np.zeros(800)}, {}, "no attribute"),
        ({"reflectance": np.zeros(3)}, {}, "each of 800 points"),
        ({"reflectance": np.full(800, 256)}, {}, "8 bits"),
        ({"reflectance": np.full(800, 0.5)}, {}, "not integers"),
        ({}, {"color": AttributeOptions()}, "not among"),
    ],
)
def test_attributes_that_cannot_be_coded_are_refused(
    attributes: dict[str, Any], options: dict[str, AttributeOptions], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        encode_cloud(POINTS, attributes, attribute_options=options)
