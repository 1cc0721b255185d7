"""Parameter sets and headers: bytes that the reference software wrote, and round trips."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcc import syntax
from gpcc.bits import BitReader, BitWriter
from gpcc.conformance import FOLDER
from pointkit.errors import InputError

# TMC13 release-v14.0, one point at (5, 6, 7), neighbour contexts within 2^8.
REFERENCE_SPS = bytes.fromhex("000000000080959dee40")
REFERENCE_GPS = bytes.fromhex("00c1f880")


def _read(function: Callable[..., None], record: Any, data: bytes, *others: Any) -> Any:
    function(BitReader(data), record, *others)
    return record


def test_a_sequence_parameter_set_of_tmc13_is_read() -> None:
    sps = _read(syntax.sequence_parameter_set, syntax.SequenceParameterSet(), REFERENCE_SPS)
    assert sps == syntax.SequenceParameterSet(seq_origin_bits=3, seq_origin_xyz=(5, 6, 7))
    assert syntax.written(syntax.sequence_parameter_set, sps) == REFERENCE_SPS


def test_a_geometry_parameter_set_of_tmc13_is_read() -> None:
    gps = _read(syntax.geometry_parameter_set, syntax.GeometryParameterSet(), REFERENCE_GPS)
    assert gps == syntax.GeometryParameterSet(
        neighbour_avail_boundary_log2_minus1=7,
        adjacent_child_contextualization_enabled_flag=1,
        gps_extension_flag=1,
    )
    assert syntax.written(syntax.geometry_parameter_set, gps) == REFERENCE_GPS


@pytest.mark.parametrize(
    ("number", "code"), [(0, "1"), (1, "010"), (2, "011"), (3, "00100"), (6, "00111")]
)
def test_exp_golomb_codes_are_the_standards(number: int, code: str) -> None:
    writer = BitWriter()
    writer.exp_golomb(number)
    padded = code.ljust(8, "0")
    assert writer.bytes() == bytes([int(padded, 2)])
    assert BitReader(writer.bytes()).exp_golomb(0) == number


@given(st.integers(-(2**31) + 1, 2**31 - 1))
def test_signed_numbers_come_back(value: int) -> None:
    class Record:
        number = value

    writer = BitWriter()
    writer.se(Record, "number")
    Record.number = 0
    BitReader(writer.bytes()).se(Record, "number")
    assert Record.number == value


THREE = st.tuples(*[st.integers(0, 2**20 - 1)] * 3)


@settings(max_examples=50)
@given(THREE, THREE, st.integers(0, 2**31), st.integers(0, 7), st.integers(0, 1))
def test_a_sequence_parameter_set_comes_back(
    origin: Any, size: Any, unit: int, order: int, flag: int
) -> None:
    sps = syntax.SequenceParameterSet(
        seq_origin_bits=20,
        seq_origin_xyz=(-origin[0], origin[1], -origin[2]),
        seq_origin_log2_scale=flag,
        seq_bbox_size_bits=20,
        seq_bbox_size_minus1_xyz=size,
        seq_unit_numerator_minus1=unit,
        seq_unit_denominator_minus1=unit // 3,
        seq_global_scale_refinement_num_bits=5,
        seq_global_scale_refinement_factor=17,
        geom_axis_order=order,
        bypass_stream_enabled_flag=flag,
    )
    data = syntax.written(syntax.sequence_parameter_set, sps)
    assert _read(syntax.sequence_parameter_set, syntax.SequenceParameterSet(), data) == sps


@given(st.integers(0, 7), st.integers(0, 3), st.integers(0, 1), st.integers(0, 127))
def test_a_geometry_parameter_set_comes_back(
    boundary: int, direct: int, flag: int, threshold: int
) -> None:
    gps = syntax.GeometryParameterSet(
        slice_geom_origin_scale_present=flag,
        gps_geom_origin_log2_scale=0 if flag else 3,
        geom_unique_points_flag=1 - flag,
        octree_point_cnt_list_present_flag=flag,
        inferred_direct_coding_mode=direct,
        joint_2pt_idcm_enabled_flag=flag if direct else 0,
        qtbt_enabled_flag=flag,
        neighbour_avail_boundary_log2_minus1=boundary,
        adjacent_child_contextualization_enabled_flag=flag if boundary else 0,
        intra_pred_max_node_size_log2=6 if boundary else 0,
        geom_planar_mode_enabled_flag=1,
        geom_planar_threshold0=threshold,
        geom_planar_threshold1=threshold // 2,
        geom_planar_threshold2=1,
        geom_idcm_rate_minus1=threshold % 32 if direct == 1 else 31,
    )
    data = syntax.written(syntax.geometry_parameter_set, gps)
    assert _read(syntax.geometry_parameter_set, syntax.GeometryParameterSet(), data) == gps


LASER = st.builds(
    syntax.Laser, st.integers(-(2**20), 2**20), st.integers(-(2**20), 2**20), st.integers(1, 4000)
)
FLAG = st.integers(0, 1)


def _angular(lasers: list[syntax.Laser], flag: int) -> dict[str, Any]:
    origin = (
        {} if flag else {"gps_angular_origin_bits_minus1": 2, "gps_angular_origin_xyz": (-7, 0, 1)}
    )
    return {
        "geom_angular_mode_enabled_flag": 1,
        "geom_slice_angular_origin_present_flag": flag,
        "lasers": lasers,
        **origin,
    }


@given(st.lists(LASER, min_size=1, max_size=9), FLAG, FLAG, st.integers(-40, 40))
def test_an_octree_of_a_sensor_comes_back(lasers: Any, flag: int, planar: int, qp: int) -> None:
    gps = syntax.GeometryParameterSet(
        **_angular(lasers, flag),
        inferred_direct_coding_mode=2,
        geom_planar_mode_enabled_flag=planar,
        planar_buffer_disabled_flag=planar,
        geom_scaling_enabled_flag=1,
        geom_base_qp=abs(qp),
        geom_qp_multiplier_log2=3,
        geom_idcm_qp_offset=qp,
    )
    data = syntax.written(syntax.geometry_parameter_set, gps)
    assert _read(syntax.geometry_parameter_set, syntax.GeometryParameterSet(), data) == gps


@given(st.lists(LASER, min_size=1, max_size=9), FLAG, FLAG, st.integers(0, 2**20))
def test_predictive_geometry_of_a_sensor_comes_back(
    lasers: Any, flag: int, scaled: int, speed: int
) -> None:
    gps = syntax.GeometryParameterSet(
        **_angular([syntax.Laser(laser.theta, laser.z) for laser in lasers], flag),
        geom_tree_type=syntax.PREDICTIVE,
        geom_angular_azimuth_scale_log2_minus11=7,
        geom_angular_azimuth_speed_minus1=speed,
        geom_angular_radius_inv_scale_log2=4,
        geom_scaling_enabled_flag=scaled,
        geom_base_qp=58 * scaled,
        geom_qp_offset_intvl_log2=9 * scaled,
        gps_extension_flag=1,
        azimuth_scaling_enabled_flag=flag,
    )
    data = syntax.written(syntax.geometry_parameter_set, gps)
    assert _read(syntax.geometry_parameter_set, syntax.GeometryParameterSet(), data) == gps
    header = syntax.GeometryHeader(
        gdu_angular_origin_bits_minus1=19 * flag,
        gdu_angular_origin_xyz=(-speed // 2, 5, 0) if flag else (0, 0, 0),
        geom_slice_qp_offset=-3 * scaled,
        geom_qp_offset_intvl_log2_delta=scaled,
        pgeom_resid_abs_log2_bits=(7, 0, 3),
        pgeom_min_radius=speed,
    )
    sps = syntax.SequenceParameterSet()
    data = syntax.written(syntax.geometry_header, header, sps, gps)
    assert _read(syntax.geometry_header, syntax.GeometryHeader(), data, sps, gps) == header


@pytest.mark.parametrize("name", ["angular", "predictive"])
def test_headers_of_tmc13_are_written_as_they_were_read(name: str) -> None:
    units = dict(syntax.payloads((FOLDER / f"{name}.bin").read_bytes()))
    sps = _read(syntax.sequence_parameter_set, syntax.SequenceParameterSet(), units[0])
    gps = _read(syntax.geometry_parameter_set, syntax.GeometryParameterSet(), units[1])
    header = _read(syntax.geometry_header, syntax.GeometryHeader(), units[2], sps, gps)
    assert syntax.written(syntax.geometry_parameter_set, gps) == units[1]
    written = syntax.written(syntax.geometry_header, header, sps, gps)
    assert written == units[2][: len(written)]


def test_a_sensor_has_a_bound_on_its_lasers() -> None:
    gps = syntax.GeometryParameterSet(
        **_angular([syntax.Laser()] * (syntax.MAX_LASERS + 1), 1), geom_tree_type=syntax.PREDICTIVE
    )
    with pytest.raises(InputError, match="lasers"):
        syntax.written(syntax.geometry_parameter_set, gps)


@given(st.lists(st.integers(1, 7), min_size=1, max_size=63), THREE, st.integers(0, 9))
def test_a_slice_header_comes_back(axes: list[int], origin: Any, number: int) -> None:
    sps = syntax.SequenceParameterSet(slice_tag_bits=6, entropy_continuation_enabled_flag=1)
    gps = syntax.GeometryParameterSet(qtbt_enabled_flag=1)
    header = syntax.GeometryHeader(
        slice_id=number,
        slice_tag=63,
        frame_ctr_lsb=1,
        entropy_continuation_flag=1,
        prev_slice_id=number + 1,
        slice_geom_origin_bits_minus1=19,
        slice_geom_origin_xyz=origin,
        tree_depth_minus1=len(axes) - 1,
        tree_lvl_coded_axis_list=axes,
        geom_stream_cnt_minus1=number,
    )
    data = syntax.written(syntax.geometry_header, header, sps, gps)
    assert _read(syntax.geometry_header, syntax.GeometryHeader(), data, sps, gps) == header


def test_the_points_are_counted_in_the_footer() -> None:
    gps = syntax.GeometryParameterSet(octree_point_cnt_list_present_flag=1)
    data = b"coded" + syntax.footer_of(8) + syntax.footer_of(71) + syntax.footer_of(2**24)
    header = syntax.GeometryHeader(tree_depth_minus1=2)
    assert syntax.point_count(data, header, gps) == (2**24, 9)


@pytest.mark.parametrize("data", [REFERENCE_SPS, REFERENCE_GPS])
def test_every_truncation_is_an_error(data: bytes) -> None:
    function: Any = syntax.sequence_parameter_set
    record: Any = syntax.SequenceParameterSet
    if data == REFERENCE_GPS:
        function, record = syntax.geometry_parameter_set, syntax.GeometryParameterSet
    for length in range(len(data)):
        with pytest.raises(InputError, match="truncated"):
            _read(function, record(), data[:length])


def test_attributes_are_skipped() -> None:
    writer = BitWriter()
    writer.bits(32, 0)
    writer.bits(14, 0b0000_00001_00000)
    for number in (0, 0, 0, 0):
        writer.exp_golomb(number)
    writer.bits(1, 0)
    writer.exp_golomb(0)
    writer.exp_golomb(0)
    writer.exp_golomb(2)
    for original in (1, 0):
        for number in (2, 0, 7):
            writer.exp_golomb(number)
        writer.bits(1, original)
        if original:
            writer.exp_golomb(0)
        else:
            writer.bits(8, 2)
            writer.bits(16, 0xABCD)
        writer.exp_golomb(1)
        writer.align()
        for byte in (2, 1, 0x5A):
            writer.bits(8, byte)
    writer.bits(3, 5)
    writer.bits(3, 0b100)
    sps = _read(syntax.sequence_parameter_set, syntax.SequenceParameterSet(), writer.bytes())
    assert (sps.num_attributes, sps.geom_axis_order, sps.bypass_stream_enabled_flag) == (2, 5, 1)


def test_encapsulated_payloads_come_back() -> None:
    stream = syntax.encapsulate(0, b"abc") + syntax.encapsulate(9, b"")
    assert list(syntax.payloads(stream)) == [(0, b"abc"), (9, b"")]
    for length in (1, 4, 7, 9, 12):
        with pytest.raises(InputError, match="truncated"):
            list(syntax.payloads(stream[:length]))


def test_bytes_that_are_no_stream_are_refused() -> None:
    with pytest.raises(InputError, match="not a G-PCC stream"):
        list(syntax.payloads(b"ply\nformat ascii 1.0\n"))
