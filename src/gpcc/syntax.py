"""Syntax of G-PCC geometry: parameter sets, tile inventory, headers of data units, encapsulation.

Names and order of the syntax elements follow TMC13 (`hls.h`, `io_hls.cpp`). Encapsulation follows
Annex B of ISO/IEC 23090-9.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from gpcc.bits import BitReader, BitWriter, SyntaxElements
from pointkit.errors import InputError

Three = tuple[int, int, int]

SEQUENCE_PARAMETER_SET = 0
GEOMETRY_PARAMETER_SET = 1
GEOMETRY_DATA_UNIT = 2
ATTRIBUTE_PARAMETER_SET = 3
ATTRIBUTE_DATA_UNIT = 4
TILE_INVENTORY = 5
CONSTANT_ATTRIBUTE_DATA_UNIT = 7
_LAST_PAYLOAD_TYPE = 9

OCTREE, PREDICTIVE = 0, 1
"""Values of geom_tree_type, the kind of geometry."""
MAX_LASERS = 1024

_TLV = struct.Struct(">BI")
PREFIX_BYTES = _TLV.size
"""Number of bytes of the type and the length that precede a payload."""
_POINT_COUNT_BYTES = 3
_DEEPEST = 63
_MAX_ORIGIN_BITS = 32
_NOTHING: Three = (0, 0, 0)
_COLOURS, _SCALING, _DEFAULT_VALUE = 2, 3, 4
_UNSPECIFIED = 2


@dataclass
class AttributeDescription:
    """Description of an attribute in the sequence parameter set."""

    attr_components_minus1: int = 0
    attr_instance_id: int = 0
    attr_bitdepth_minus1: int = 7
    # Label of the standard, or None if `oid` (bytes of ITU-T X.690) is the identifier.
    attr_label: int | None = None
    oid: bytes = b""
    attr_default_value: tuple[int, ...] = ()
    # Conversion of colours (ISO/IEC 23091-2), or None.
    matrix_coefficients: int | None = None
    # The syntax elements attr_scale_minus1, attr_frac_bits and attr_offset, or None.
    scaling: Three | None = None


@dataclass
class SequenceParameterSet:
    main_profile_compatibility_flag: int = 0
    reserved_profile_compatibility_21bits: int = 0
    slice_reordering_constraint_flag: int = 0
    unique_point_positions_constraint_flag: int = 0
    level_idc: int = 0
    sps_seq_parameter_set_id: int = 0
    frame_ctr_lsb_bits: int = 1
    slice_tag_bits: int = 0
    seq_origin_bits: int = 0
    seq_origin_xyz: Three = _NOTHING
    seq_origin_log2_scale: int = 0
    seq_bbox_size_bits: int = 0
    seq_bbox_size_minus1_xyz: Three = _NOTHING
    seq_unit_numerator_minus1: int = 0
    seq_unit_denominator_minus1: int = 0
    seq_unit_is_metres_flag: int = 0
    seq_global_scale_factor_log2: int = 0
    seq_global_scale_refinement_num_bits: int = 0
    seq_global_scale_refinement_factor: int = 0
    num_attributes: int = 0
    attributes: list[AttributeDescription] = field(default_factory=list)
    geom_axis_order: int = 1
    bypass_stream_enabled_flag: int = 0
    entropy_continuation_enabled_flag: int = 0
    sps_extension_flag: int = 0


@dataclass
class Laser:
    """A laser of the sensor in a parameter set, in the units of the parameter set."""

    # Tangent of the elevation, in units of 2^-18.
    theta: int = 0
    # Negated height above the sensor's origin, in eighths of a coding unit.
    z: int = 0
    # Shots per turn (octree only).
    num_phi_per_turn: int = 0


@dataclass
class GeometryParameterSet:
    """Parameter set with the coding tools of the geometry.

    The sensor's position in it is relative to the sequence's origin.
    """

    gps_geom_parameter_set_id: int = 0
    gps_seq_parameter_set_id: int = 0
    slice_geom_origin_scale_present: int = 1
    gps_geom_origin_log2_scale: int = 0
    geom_unique_points_flag: int = 1
    geom_tree_type: int = 0
    octree_point_cnt_list_present_flag: int = 0
    inferred_direct_coding_mode: int = 0
    joint_2pt_idcm_enabled_flag: int = 0
    qtbt_enabled_flag: int = 0
    neighbour_avail_boundary_log2_minus1: int = 0
    adjacent_child_contextualization_enabled_flag: int = 0
    intra_pred_max_node_size_log2: int = 0
    bitwise_occupancy_coding_flag: int = 1
    geom_planar_mode_enabled_flag: int = 0
    geom_planar_threshold0: int = 0
    geom_planar_threshold1: int = 0
    geom_planar_threshold2: int = 0
    geom_idcm_rate_minus1: int = 31
    geom_angular_mode_enabled_flag: int = 0
    geom_slice_angular_origin_present_flag: int = 0
    gps_angular_origin_bits_minus1: int = 0
    gps_angular_origin_xyz: Three = _NOTHING
    geom_angular_azimuth_scale_log2_minus11: int = 0
    geom_angular_azimuth_speed_minus1: int = 0
    geom_angular_radius_inv_scale_log2: int = 0
    lasers: list[Laser] = field(default_factory=list)
    planar_buffer_disabled_flag: int = 0
    geom_scaling_enabled_flag: int = 0
    geom_base_qp: int = 0
    geom_qp_multiplier_log2: int = 0
    geom_qp_offset_intvl_log2: int = 0
    geom_idcm_qp_offset: int = 0
    gps_extension_flag: int = 0
    trisoup_enabled_flag: int = 0
    azimuth_scaling_enabled_flag: int = 0


@dataclass
class GeometryHeader:
    """Header of a slice of geometry.

    The sensor's position in it, if there is a sensor, is relative to the slice's origin.
    """

    gdu_geometry_parameter_set_id: int = 0
    gdu_reserved_zero_3bits: int = 0
    slice_id: int = 0
    slice_tag: int = 0
    frame_ctr_lsb: int = 0
    entropy_continuation_flag: int = 0
    prev_slice_id: int = 0
    slice_geom_origin_log2_scale: int = 0
    slice_geom_origin_bits_minus1: int = 0
    slice_geom_origin_xyz: Three = _NOTHING
    gdu_angular_origin_bits_minus1: int = 0
    gdu_angular_origin_xyz: Three = _NOTHING
    tree_depth_minus1: int = 0
    tree_lvl_coded_axis_list: list[int] = field(default_factory=list)
    geom_stream_cnt_minus1: int = 0
    geom_slice_qp_offset: int = 0
    geom_qp_offset_intvl_log2_delta: int = 0
    pgeom_resid_abs_log2_bits: Three = _NOTHING
    pgeom_min_radius: int = 0


def sequence_parameter_set(io: SyntaxElements, sps: SequenceParameterSet) -> None:
    io.flag(sps, "main_profile_compatibility_flag")
    io.u(sps, "reserved_profile_compatibility_21bits", 21)
    io.flag(sps, "slice_reordering_constraint_flag", "unique_point_positions_constraint_flag")
    io.u(sps, "level_idc", 8)
    io.u(sps, "sps_seq_parameter_set_id", 4)
    io.u(sps, "frame_ctr_lsb_bits", 5)
    io.u(sps, "slice_tag_bits", 5)
    io.ue(sps, "seq_origin_bits")
    if sps.seq_origin_bits:
        io.s3(sps, "seq_origin_xyz", sps.seq_origin_bits)
        io.ue(sps, "seq_origin_log2_scale")
    io.ue(sps, "seq_bbox_size_bits")
    if sps.seq_bbox_size_bits:
        io.u3(sps, "seq_bbox_size_minus1_xyz", sps.seq_bbox_size_bits)
    io.ue(sps, "seq_unit_numerator_minus1", "seq_unit_denominator_minus1")
    io.flag(sps, "seq_unit_is_metres_flag")
    io.ue(sps, "seq_global_scale_factor_log2", "seq_global_scale_refinement_num_bits")
    io.u(sps, "seq_global_scale_refinement_factor", sps.seq_global_scale_refinement_num_bits)
    io.ue(sps, "num_attributes")
    if not io.writing:
        sps.attributes = []
    for index in range(sps.num_attributes):
        if not io.writing:
            sps.attributes.append(AttributeDescription())
        _attribute_description(io, sps.attributes[index])
    io.u(sps, "geom_axis_order", 3)
    io.flag(sps, "bypass_stream_enabled_flag", "entropy_continuation_enabled_flag")
    io.flag(sps, "sps_extension_flag")


def _attribute_description(io: SyntaxElements, attribute: AttributeDescription) -> None:
    io.ue(attribute, "attr_components_minus1", "attr_instance_id", "attr_bitdepth_minus1")
    if io.bits(1, attribute.attr_label is not None):
        attribute.attr_label = io.exp_golomb(attribute.attr_label or 0)
    else:
        io.bits(1, 0)
        attribute.oid = _octets(io, attribute.oid, 7)
    parameters = _attribute_parameters(attribute) if io.writing else []
    count = io.exp_golomb(len(parameters))
    io.align()
    for index in range(count):
        kind = io.bits(8, parameters[index] if io.writing else 0)
        writer = BitWriter()
        if io.writing:
            _attribute_parameter(writer, attribute, kind)
        content = _octets(io, writer.bytes(), 8)
        if not io.writing:
            _attribute_parameter(BitReader(content), attribute, kind)


def _octets(io: SyntaxElements, octets: bytes, bits: int) -> bytes:
    length = io.bits(bits, len(octets))
    return bytes(io.bits(8, octet) for octet in octets or bytes(length))


def _attribute_parameters(attribute: AttributeDescription) -> list[int]:
    """Return the kinds of parameters that an attribute has."""
    values = (
        attribute.attr_default_value or None,
        attribute.matrix_coefficients,
        attribute.scaling,
    )
    kinds = (_DEFAULT_VALUE, _COLOURS, _SCALING)
    return [kind for kind, value in zip(kinds, values, strict=True) if value is not None]


def _attribute_parameter(io: SyntaxElements, attribute: AttributeDescription, kind: int) -> None:
    if kind == _DEFAULT_VALUE:
        bits, components = attribute.attr_bitdepth_minus1 + 1, attribute.attr_components_minus1 + 1
        refuse(bits * components > 8 * 255, "an attribute with so many components")
        values = attribute.attr_default_value or (0,) * components
        attribute.attr_default_value = tuple(io.bits(bits, value) for value in values)
    elif kind == _COLOURS:
        io.exp_golomb(_UNSPECIFIED)
        io.exp_golomb(_UNSPECIFIED)
        attribute.matrix_coefficients = io.exp_golomb(attribute.matrix_coefficients or 0)
        if io.writing:
            io.bits(1, 1)  # full range
    elif kind == _SCALING:
        scale_minus1, frac_bits, offset = attribute.scaling or (0, 0, 0)
        bits = io.exp_golomb(max(abs(offset).bit_length(), 1))
        size = io.bits(bits, abs(offset))
        offset = -size if io.bits(1, offset < 0) else size
        bits = io.exp_golomb(max(scale_minus1.bit_length(), 1))
        scale_minus1 = io.bits(bits, scale_minus1)
        attribute.scaling = (scale_minus1, io.exp_golomb(frac_bits), offset)


def geometry_parameter_set(io: SyntaxElements, gps: GeometryParameterSet) -> None:
    io.u(gps, "gps_geom_parameter_set_id", 4)
    io.u(gps, "gps_seq_parameter_set_id", 4)
    io.flag(gps, "slice_geom_origin_scale_present")
    if not gps.slice_geom_origin_scale_present:
        io.ue(gps, "gps_geom_origin_log2_scale")
    io.flag(gps, "geom_unique_points_flag", "geom_tree_type")
    if gps.geom_tree_type == OCTREE:
        _octree_tools(io, gps)
    io.flag(gps, "geom_angular_mode_enabled_flag")
    if gps.geom_angular_mode_enabled_flag:
        _angular_mode(io, gps)
    io.flag(gps, "geom_scaling_enabled_flag")
    if gps.geom_scaling_enabled_flag:
        _scaling(io, gps)
    io.flag(gps, "gps_extension_flag")
    if gps.gps_extension_flag:
        io.flag(gps, "trisoup_enabled_flag")
        if gps.geom_tree_type == PREDICTIVE and gps.geom_angular_mode_enabled_flag:
            io.flag(gps, "azimuth_scaling_enabled_flag")


def _octree_tools(io: SyntaxElements, gps: GeometryParameterSet) -> None:
    io.flag(gps, "octree_point_cnt_list_present_flag")
    io.u(gps, "inferred_direct_coding_mode", 2)
    if gps.inferred_direct_coding_mode:
        io.flag(gps, "joint_2pt_idcm_enabled_flag")
    io.flag(gps, "qtbt_enabled_flag")
    io.u(gps, "neighbour_avail_boundary_log2_minus1", 3)
    if gps.neighbour_avail_boundary_log2_minus1:
        io.flag(gps, "adjacent_child_contextualization_enabled_flag")
        io.ue(gps, "intra_pred_max_node_size_log2")
    io.flag(gps, "bitwise_occupancy_coding_flag", "geom_planar_mode_enabled_flag")
    if gps.geom_planar_mode_enabled_flag:
        io.ue(gps, "geom_planar_threshold0", "geom_planar_threshold1", "geom_planar_threshold2")
        if gps.inferred_direct_coding_mode == 1:
            io.u(gps, "geom_idcm_rate_minus1", 5)


def _angular_mode(io: SyntaxElements, gps: GeometryParameterSet) -> None:
    io.flag(gps, "geom_slice_angular_origin_present_flag")
    if not gps.geom_slice_angular_origin_present_flag:
        _angular_origin(io, gps, "gps_angular_origin")
    predictive = gps.geom_tree_type == PREDICTIVE
    if predictive:
        io.ue(gps, "geom_angular_azimuth_scale_log2_minus11", "geom_angular_azimuth_speed_minus1")
        io.ue(gps, "geom_angular_radius_inv_scale_log2")
    _laser_table(io, gps, turns=not predictive)
    if not predictive and gps.geom_planar_mode_enabled_flag:
        io.flag(gps, "planar_buffer_disabled_flag")


def _angular_origin(io: SyntaxElements, record: Any, name: str) -> None:
    io.ue(record, f"{name}_bits_minus1")
    bits = getattr(record, f"{name}_bits_minus1") + 1
    refuse(bits > _MAX_ORIGIN_BITS, "a sensor so far away")
    io.s3(record, f"{name}_xyz", bits)


def _laser_table(io: SyntaxElements, gps: GeometryParameterSet, *, turns: bool) -> None:
    """Read or write the lasers, each as differences from the laser before."""
    # From the third laser on, elevations are differences from a linear extrapolation.
    count = io.exp_golomb(len(gps.lasers) - 1 if io.writing else 0) + 1
    refuse(count > MAX_LASERS, f"a sensor of more than {MAX_LASERS} lasers")
    lasers = gps.lasers if io.writing else [Laser() for _ in range(count)]
    before: tuple[Laser, ...] = ()
    for laser in lasers:
        last = before[-1] if before else Laser()
        theta = 2 * last.theta - before[-2].theta if len(before) == 2 else last.theta
        laser.theta = theta + io.signed(laser.theta - theta)
        laser.z = last.z + io.signed(laser.z - last.z)
        if turns and not before:
            laser.num_phi_per_turn = 1 + io.exp_golomb(max(laser.num_phi_per_turn - 1, 0))
        elif turns:
            laser.num_phi_per_turn = last.num_phi_per_turn + io.signed(
                laser.num_phi_per_turn - last.num_phi_per_turn
            )
        refuse(
            max(map(abs, (laser.theta, laser.z, laser.num_phi_per_turn))) >= 1 << 31, "such a laser"
        )
        before = (*before[-1:], laser)
    gps.lasers = lasers


def _scaling(io: SyntaxElements, gps: GeometryParameterSet) -> None:
    io.ue(gps, "geom_base_qp")
    io.u(gps, "geom_qp_multiplier_log2", 2)
    if gps.geom_tree_type == PREDICTIVE:
        io.ue(gps, "geom_qp_offset_intvl_log2")
    elif gps.inferred_direct_coding_mode:
        io.se(gps, "geom_idcm_qp_offset")


def check_tools(gps: GeometryParameterSet) -> None:
    octree = gps.geom_tree_type == OCTREE
    refuse(octree and not gps.bitwise_occupancy_coding_flag, "bytewise occupancy coding")
    refuse(octree and gps.geom_scaling_enabled_flag, "geometry scaling")
    refuse(gps.trisoup_enabled_flag, "trisoup")


def refuse(used: Any, tool: str) -> None:
    if used:
        raise InputError(f"G-PCC stream: {tool} is not supported")


def geometry_header(
    io: SyntaxElements, header: GeometryHeader, sps: SequenceParameterSet, gps: GeometryParameterSet
) -> None:
    io.u(header, "gdu_geometry_parameter_set_id", 4)
    io.u(header, "gdu_reserved_zero_3bits", 3)
    io.ue(header, "slice_id")
    io.u(header, "slice_tag", sps.slice_tag_bits)
    io.u(header, "frame_ctr_lsb", sps.frame_ctr_lsb_bits)
    if sps.entropy_continuation_enabled_flag:
        io.flag(header, "entropy_continuation_flag")
        if header.entropy_continuation_flag:
            io.ue(header, "prev_slice_id")
    if gps.slice_geom_origin_scale_present:
        io.ue(header, "slice_geom_origin_log2_scale")
    io.ue(header, "slice_geom_origin_bits_minus1")
    io.u3(header, "slice_geom_origin_xyz", header.slice_geom_origin_bits_minus1 + 1)
    if gps.geom_angular_mode_enabled_flag and gps.geom_slice_angular_origin_present_flag:
        _angular_origin(io, header, "gdu_angular_origin")
    if gps.geom_tree_type == OCTREE:
        io.ue(header, "tree_depth_minus1")
        refuse(header.tree_depth_minus1 >= _DEEPEST, f"a tree of more than {_DEEPEST} levels")
        _coded_axes(io, header, gps)
        io.ue(header, "geom_stream_cnt_minus1")
    if gps.geom_scaling_enabled_flag:
        io.se(header, "geom_slice_qp_offset")
        if gps.geom_tree_type == PREDICTIVE:
            io.ue(header, "geom_qp_offset_intvl_log2_delta")
    if gps.geom_tree_type == PREDICTIVE:
        io.u3(header, "pgeom_resid_abs_log2_bits", 3)
        if gps.geom_angular_mode_enabled_flag:
            io.ue(header, "pgeom_min_radius")


def _coded_axes(io: SyntaxElements, header: GeometryHeader, gps: GeometryParameterSet) -> None:
    if not io.writing:
        header.tree_lvl_coded_axis_list = [7] * (header.tree_depth_minus1 + 1)
    if gps.qtbt_enabled_flag:
        axes = header.tree_lvl_coded_axis_list
        header.tree_lvl_coded_axis_list = [io.bits(3, value) for value in axes]


def point_count(data: bytes, header: GeometryHeader, gps: GeometryParameterSet) -> tuple[int, int]:
    """Return the number of points that a data unit's footer states.

    The second result is the number of bytes of the footer.
    """
    levels = header.tree_depth_minus1 if gps.octree_point_cnt_list_present_flag else 0
    length = _POINT_COUNT_BYTES * (levels + 1)
    if length > len(data):
        raise InputError("G-PCC stream: a geometry data unit is truncated")
    return int.from_bytes(data[-_POINT_COUNT_BYTES:]) + 1, length


def footer_of(points: int) -> bytes:
    return (points - 1).to_bytes(_POINT_COUNT_BYTES)


def written(syntax: Callable[..., None], *records: Any) -> bytes:
    writer = BitWriter()
    syntax(writer, *records)
    return writer.bytes()


def encapsulate(payload_type: int, payload: bytes) -> bytes:
    """Return a payload after its type and length (Annex B)."""
    return _TLV.pack(payload_type, len(payload)) + payload


def payloads(stream: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the type and the content of each payload of a stream."""
    place = 0
    while place < len(stream):
        if len(stream) - place < _TLV.size:
            raise InputError("G-PCC stream: truncated")
        payload_type, length = _TLV.unpack_from(stream, place)
        place += _TLV.size
        if payload_type > _LAST_PAYLOAD_TYPE:
            raise InputError("not a G-PCC stream, or a damaged one")
        if length > len(stream) - place:
            raise InputError("G-PCC stream: truncated")
        yield payload_type, stream[place : place + length]
        place += length
