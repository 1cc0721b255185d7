"""Syntax of attributes: parameter sets, and headers of data units.

Syntax elements are those of TMC13, as in `gpcc.syntax`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from gpcc.bits import SyntaxElements
from gpcc.syntax import AttributeDescription, Three, refuse
from pointkit.errors import InputError

RAHT, PREDICTING, LIFTING, RAW = range(4)
"""Values of attr_encoding, the transform."""
BY_DISTANCE, PERIODIC, CENTROID = range(3)
"""Values of lod_decimation_type, which says how levels of detail are chosen."""

MAX_DETAIL_LEVELS = 256
SCALABLE_LEVELS = 21
SKIP_ALL_LAYERS = 0x7FFFFFFF
_MOST_REGIONS = 255
_MOST_BITS = 32
_MOST_DIST2 = 40


@dataclass
class AttributeParameterSet:
    """Parameter set with the coding tools of an attribute.

    The elements lod_neigh_bias and attr_coord_scale are factors along the axes.
    """

    aps_attr_parameter_set_id: int = 0
    aps_seq_parameter_set_id: int = 0
    attr_encoding: int = PREDICTING
    init_qp_minus4: int = 0
    aps_chroma_qp_offset: int = 0
    aps_slice_qp_deltas_present_flag: int = 0
    num_pred_nearest_neighbours_minus1: int = 0
    inter_lod_search_range: int = 0
    lod_neigh_bias: Three = (1, 1, 1)
    last_component_prediction_enabled_flag: int = 0
    scalable_lifting_enabled_flag: int = 0
    max_neigh_range_minus1: int = 0
    num_detail_levels_minus1: int = 0
    canonical_point_order_flag: int = 0
    lod_decimation_type: int = BY_DISTANCE
    lod_sampling_period: list[int] = field(default_factory=list)
    dist2: int = 0
    aps_slice_dist2_deltas_present_flag: int = 0
    max_num_direct_predictors: int = 0
    adaptive_prediction_threshold: int = 0
    direct_avg_predictor_disabled_flag: int = 0
    intra_lod_prediction_skip_layers: int = SKIP_ALL_LAYERS
    intra_lod_search_range: int = 0
    inter_component_prediction_enabled_flag: int = 0
    pred_weight_blending_enabled_flag: int = 0
    raht_prediction_enabled_flag: int = 0
    raht_prediction_threshold0: int = 0
    raht_prediction_threshold1: int = 0
    raw_attr_variable_len_flag: int = 0
    spherical_coord_flag: int = 0
    attr_coord_scale: list[int] = field(default_factory=lambda: [0, 0, 0])
    aps_extension_flag: int = 0
    quant_neigh_weight: list[int] = field(default_factory=lambda: [0, 0, 0])

    @property
    def has_levels(self) -> bool:
        return self.attr_encoding in (PREDICTING, LIFTING)

    @property
    def max_detail_levels(self) -> int:
        if self.scalable_lifting_enabled_flag:
            return SCALABLE_LEVELS
        return self.num_detail_levels_minus1 + 1


@dataclass
class QpRegion:
    origin: Three = (0, 0, 0)
    size_minus1: Three = (0, 0, 0)
    qp_offset: int = 0
    chroma_qp_offset: int = 0


@dataclass
class AttributeHeader:
    """Header of a data unit with attribute values of a slice."""

    attr_attr_parameter_set_id: int = 0
    attr_sps_attr_idx: int = 0
    attr_geom_slice_id: int = 0
    attr_dist2_delta: int = 0
    # Factor of each level of detail.
    last_component_coeffs: list[int] = field(default_factory=list)
    # Factors of the second and third component in each level of detail.
    inter_component_coeffs: list[tuple[int, int]] = field(default_factory=list)
    attr_qp_delta_luma: int = 0
    attr_qp_delta_chroma: int = 0
    # QP offsets of the first and the other components in each layer.
    layer_qp_deltas: list[tuple[int, int]] = field(default_factory=list)
    attr_region_bits_minus1: int = 0
    regions: list[QpRegion] = field(default_factory=list)


def attribute_parameter_set(io: SyntaxElements, aps: AttributeParameterSet) -> None:
    io.u(aps, "aps_attr_parameter_set_id", 4)
    io.u(aps, "aps_seq_parameter_set_id", 4)
    io.ue(aps, "attr_encoding")
    refuse(aps.attr_encoding > RAW, "this transform of attributes")
    io.ue(aps, "init_qp_minus4")
    io.se(aps, "aps_chroma_qp_offset")
    io.flag(aps, "aps_slice_qp_deltas_present_flag")
    if aps.has_levels:
        _levels_of_detail(io, aps)
    _transform_tools(io, aps)
    if not aps.scalable_lifting_enabled_flag:
        io.flag(aps, "spherical_coord_flag")
    if aps.spherical_coord_flag:
        for axis, scale in enumerate(aps.attr_coord_scale):
            bits = 1 + io.bits(5, max(scale.bit_length() - 1, 0))
            aps.attr_coord_scale[axis] = io.bits(bits, scale)
    io.flag(aps, "aps_extension_flag")
    if aps.aps_extension_flag and (io.writing or aps.attr_encoding == PREDICTING):
        for k in range(aps.num_pred_nearest_neighbours_minus1 + 1):
            aps.quant_neigh_weight[k] = io.exp_golomb(aps.quant_neigh_weight[k])


def _transform_tools(io: SyntaxElements, aps: AttributeParameterSet) -> None:
    if aps.attr_encoding == PREDICTING:
        io.ue(aps, "max_num_direct_predictors")
        if aps.max_num_direct_predictors:
            io.u(aps, "adaptive_prediction_threshold", 8)
            io.flag(aps, "direct_avg_predictor_disabled_flag")
        io.ue(aps, "intra_lod_prediction_skip_layers", "intra_lod_search_range")
        io.flag(aps, "inter_component_prediction_enabled_flag", "pred_weight_blending_enabled_flag")
    elif aps.attr_encoding == RAHT:
        io.flag(aps, "raht_prediction_enabled_flag")
        if aps.raht_prediction_enabled_flag:
            io.ue(aps, "raht_prediction_threshold0", "raht_prediction_threshold1")
    elif aps.attr_encoding == RAW:
        io.flag(aps, "raw_attr_variable_len_flag")


def _levels_of_detail(io: SyntaxElements, aps: AttributeParameterSet) -> None:
    io.ue(aps, "num_pred_nearest_neighbours_minus1")
    refuse(aps.num_pred_nearest_neighbours_minus1 > 2, "prediction from so many neighbours")
    io.ue(aps, "inter_lod_search_range")
    x, y, z = (1 + io.exp_golomb(bias - 1) for bias in aps.lod_neigh_bias)
    aps.lod_neigh_bias = (x, y, z)
    if aps.attr_encoding == LIFTING:
        io.flag(aps, "last_component_prediction_enabled_flag")
    io.flag(aps, "scalable_lifting_enabled_flag")
    if aps.scalable_lifting_enabled_flag:
        io.ue(aps, "max_neigh_range_minus1")
        return
    io.ue(aps, "num_detail_levels_minus1")
    refuse(aps.num_detail_levels_minus1 >= MAX_DETAIL_LEVELS, "so many levels of detail")
    if not aps.num_detail_levels_minus1:
        io.flag(aps, "canonical_point_order_flag")
        return
    io.ue(aps, "lod_decimation_type")
    refuse(aps.lod_decimation_type > CENTROID, "this kind of decimation")
    if aps.lod_decimation_type != BY_DISTANCE:
        periods = aps.lod_sampling_period if io.writing else [2] * aps.num_detail_levels_minus1
        aps.lod_sampling_period = [2 + io.exp_golomb(period - 2) for period in periods]
    if aps.lod_decimation_type != PERIODIC:
        io.ue(aps, "dist2")
        io.flag(aps, "aps_slice_dist2_deltas_present_flag")


def attribute_header(
    io: SyntaxElements,
    header: AttributeHeader,
    aps: AttributeParameterSet,
    attributes: list[AttributeDescription],
) -> None:
    attribute_ids(io, header)
    if header.attr_sps_attr_idx >= len(attributes):
        raise InputError("G-PCC stream: values of an attribute that is not described")
    components = attributes[header.attr_sps_attr_idx].attr_components_minus1 + 1
    if aps.aps_slice_dist2_deltas_present_flag:
        io.se(header, "attr_dist2_delta")
    dist2 = aps.dist2 + header.attr_dist2_delta
    refuse(not 0 <= dist2 <= _MOST_DIST2, "this distance of points in levels of detail")
    levels = aps.max_detail_levels
    if (
        aps.attr_encoding == LIFTING
        and aps.last_component_prediction_enabled_flag
        and components == 3
    ):
        coeffs = header.last_component_coeffs if io.writing else [0] * levels
        header.last_component_coeffs = _differences(io, coeffs)
    if (
        aps.attr_encoding == PREDICTING
        and aps.inter_component_prediction_enabled_flag
        and components > 1
    ):
        pairs = header.inter_component_coeffs if io.writing else [(0, 0)] * levels
        flat = _differences(io, [coeff for pair in pairs for coeff in pair], 2)
        header.inter_component_coeffs = list(zip(flat[::2], flat[1::2], strict=True))
    if aps.aps_slice_qp_deltas_present_flag:
        io.se(header, "attr_qp_delta_luma", "attr_qp_delta_chroma")
    if io.bits(1, bool(header.layer_qp_deltas)):
        count = 1 + io.exp_golomb(max(len(header.layer_qp_deltas) - 1, 0))
        refuse(count > MAX_DETAIL_LEVELS, "so many layers")
        deltas = header.layer_qp_deltas if io.writing else [(0, 0)] * count
        header.layer_qp_deltas = [(io.signed(luma), io.signed(chroma)) for luma, chroma in deltas]
    _regions(io, header, components)
    io.align()


def attribute_ids(io: SyntaxElements, header: AttributeHeader) -> None:
    io.u(header, "attr_attr_parameter_set_id", 4)
    io.bits(3, 0)
    io.ue(header, "attr_sps_attr_idx", "attr_geom_slice_id")


def _differences(io: SyntaxElements, values: list[int], stride: int = 1) -> list[int]:
    """Read or write 8-bit values as differences from values `stride` places before, initially 4."""
    result: list[int] = [4] * stride
    for value in values:
        coded = result[-stride] + io.signed(value - result[-stride])
        result.append((coded + 128) % 256 - 128)
    return result[stride:]


def _regions(io: SyntaxElements, header: AttributeHeader, components: int) -> None:
    count = io.exp_golomb(len(header.regions))
    refuse(count > _MOST_REGIONS, "so many regions")
    if count:
        io.ue(header, "attr_region_bits_minus1")
    bits = header.attr_region_bits_minus1 + 1
    refuse(bits > _MOST_BITS, "a region so large")
    regions = header.regions if io.writing else [QpRegion() for _ in range(count)]
    for region in regions:
        io.u3(region, "origin", bits)
        io.u3(region, "size_minus1", bits)
        io.se(region, "qp_offset")
        if components > 1:
            io.se(region, "chroma_qp_offset")
    header.regions = regions
