"""Decoder of G-PCC streams with attributes for benchmarks/checks/fuzz.py, and streams."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from gpcc import AttributeOptions, GpccOptions, decode_cloud, encode_cloud, syntax
from gpcc.attributes.syntax import (
    RAW,
    AttributeHeader,
    AttributeParameterSet,
    QpRegion,
    attribute_header,
    attribute_parameter_set,
)
from gpcc.bits import BitReader
from gpcc.conformance import FOLDER
from tests.support.structured_streams import change, data, limit

Random = np.random.Generator
_KINDS = (("raht", "predicting", "lifting"), ("color", "reflectance"), (0, 6))


class AttributesDecoder:
    """Decodes points with attributes."""

    def streams(self) -> list[bytes]:
        """Return the conformance vectors of attributes, and streams of one and of 3,000 points."""
        whole = [path.read_bytes() for path in sorted((FOLDER / "attributes").glob("*.bin"))]
        random = np.random.default_rng(0)
        for transform, name, levels in product(*_KINDS):
            for count in (1, 3000):
                cloud = random.integers(0, 200, (count, 3))
                values = random.integers(0, 256, (count, 3)[: 1 + (name == "color")])
                options = AttributeOptions(
                    transform=transform,  # type: ignore[arg-type]
                    level_of_detail_count=levels,
                    intra_lod_prediction_skip_layers=0,
                    qp=int(random.integers(4, 40)),
                )
                tools = GpccOptions(slice_max_points=2000, merge_duplicates=False)
                whole.append(encode_cloud(cloud, {name: values}, tools, {name: options}))
        return whole

    def decode(self, stream: bytes) -> NDArray[np.float64]:
        """Return the positions; the attributes must have their shape."""
        cloud = decode_cloud(stream)
        assert all(len(values) == len(cloud.points) for values in cloud.attributes.values())
        return cloud.positions()


def with_changed_attributes(streams: Sequence[bytes], random: Random) -> bytes:
    """Other descriptions, parameter sets, headers and values for the geometry of a stream."""
    units = list(syntax.payloads(streams[random.integers(len(streams))]))
    sps, sets = _parameter_sets(units)
    if random.random() < 0.3:
        for each in sps.attributes:
            each.attr_bitdepth_minus1 = int(random.choice([0, 7, 9, 15, 16]))
            each.attr_components_minus1 = int(random.choice([0, 2, 2, 1]))
            each.attr_label = int(random.choice([0, 1, 2, 6, 9]))
    sps.bypass_stream_enabled_flag |= int(random.random() < 0.05)
    for aps in sets.values():
        _change_set(aps, random)
    parts = []
    for kind, payload in units:
        body = payload
        if kind == syntax.SEQUENCE_PARAMETER_SET:
            body = syntax.written(syntax.sequence_parameter_set, sps)
        elif kind == syntax.ATTRIBUTE_PARAMETER_SET:
            body = syntax.written(attribute_parameter_set, sets[payload[0] >> 4])
        elif kind == syntax.ATTRIBUTE_DATA_UNIT:
            body = _unit(payload, sets[payload[0] >> 4], sps, random)
        parts.append(syntax.encapsulate(kind, body))
    if random.random() < 0.1:
        parts.insert(int(random.integers(len(parts))), parts[int(random.integers(len(parts)))])
    return b"".join(parts)


def _parameter_sets(
    units: Sequence[tuple[int, bytes]],
) -> tuple[syntax.SequenceParameterSet, dict[int, AttributeParameterSet]]:
    sps, sets = syntax.SequenceParameterSet(), {}
    for kind, payload in units:
        if kind == syntax.SEQUENCE_PARAMETER_SET:
            syntax.sequence_parameter_set(BitReader(payload), sps)
        elif kind == syntax.ATTRIBUTE_PARAMETER_SET:
            aps = AttributeParameterSet()
            attribute_parameter_set(BitReader(payload), aps)
            sets[payload[0] >> 4] = aps
    return sps, sets


def _change_set(aps: AttributeParameterSet, random: Random) -> None:
    if random.random() < 0.3:
        aps.attr_encoding = int(random.integers(RAW + 1))
    if random.random() < 0.3:
        aps.num_detail_levels_minus1 = int(random.choice([0, 1, 20, 255]))
        aps.scalable_lifting_enabled_flag = int(random.integers(2))
    change(aps, random, float(random.choice([0, 0.1, 0.3])))
    aps.num_pred_nearest_neighbours_minus1 %= 3
    far = int(random.choice([3, 8, 31]))
    if random.random() < 0.5:
        aps.lod_neigh_bias = tuple(1 + limit(random, far) for _ in range(3))  # type: ignore[assignment]
        aps.dist2 = limit(random, 6)
        aps.intra_lod_search_range, aps.inter_lod_search_range = (
            limit(random, int(random.choice([7, 20, 32]))) for _ in range(2)
        )
        aps.max_neigh_range_minus1 = limit(random, 20)
        aps.adaptive_prediction_threshold = limit(random, 8)
        aps.init_qp_minus4 = limit(random, 7)
    if random.random() < 0.3:
        aps.aps_extension_flag = 1
        aps.quant_neigh_weight = [limit(random, far) for _ in range(3)]
        aps.attr_coord_scale = [limit(random, far) for _ in range(3)]
    periods = limit(random, 24)
    aps.lod_sampling_period = [
        max(2, periods >> int(random.integers(3))) for _ in range(aps.num_detail_levels_minus1)
    ]
    aps.aps_attr_parameter_set_id = min(aps.aps_attr_parameter_set_id, 15)


def _unit(
    payload: bytes, aps: AttributeParameterSet, sps: syntax.SequenceParameterSet, random: Random
) -> bytes:
    """Return a data unit with another header, and its own coefficients or others."""
    header = AttributeHeader(aps.aps_attr_parameter_set_id)
    ids = BitReader(payload)
    ids.bits(4), ids.bits(3)
    header.attr_sps_attr_idx, header.attr_geom_slice_id = ids.exp_golomb(0), ids.exp_golomb(0)
    levels = aps.max_detail_levels

    def signed(bits: int) -> int:
        return limit(random, bits) * int(random.choice([-1, 1]))

    header.last_component_coeffs = [signed(7) for _ in range(levels)]
    header.inter_component_coeffs = [(signed(7), signed(7)) for _ in range(levels)]
    header.attr_dist2_delta = signed(5) if random.random() < 0.3 else 0
    if random.random() < 0.3:
        layers = int(random.choice([1, 3, 256]))
        header.layer_qp_deltas = [(signed(8), signed(8)) for _ in range(layers)]
    if random.random() < 0.2:
        header.attr_region_bits_minus1 = 31
        corner = (limit(random, 31), 0, limit(random, 8))
        regions = int(random.choice([1, 2, 256]))
        header.regions = [QpRegion(corner, (999, 1 << 30, 9), signed(8), 1)] * regions
    body = payload[int(random.integers(2, 9)) :] if random.random() < 0.5 else data(random)
    return syntax.written(attribute_header, header, aps, sps.attributes) + body
