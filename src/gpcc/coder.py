from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc import syntax
from gpcc.attributes.geometry import SlicePoints
from gpcc.bits import BitReader
from gpcc.contexts import initial_contexts
from gpcc.options import PROFILES, GpccOptions
from gpcc.predictive import initial_probabilities
from gpcc.predictive_slices import decode_trees, placed
from gpcc.sensor import SensorDescription
from gpcc.slices import (
    CodedSlice,
    data_unit,
    decode_slice,
    encode_octree,
    read_slice,
    sensor_position,
    sensor_state,
)
from gpcc.syntax import Three
from gpcc.tree import Tree, build_tree, coded_axes, leaf_codes, sorted_rows
from pointkit.errors import InputError
from pointkit.geometry.morton import MOST_BITS, Ints, morton_points
from pointkit.geometry.spatial_order import bounding_corners, sort_keys
from pointkit.threads import in_threads

if TYPE_CHECKING:
    from gpcc.attributes.reader import AttributeReader
    from gpcc.attributes.writer import AttributeEncoder

Units = list[tuple[int, bytes]]
"""Type and payload of each data unit of a slice."""

MAX_POINTS = 1 << 24
"""Maximum number of points of a stream, which bounds the memory."""
MAX_LEVELS = 1 << 14
"""Maximum sum of the octree levels of a stream's slices, which bounds the time."""
_LEVELS_OF_TREES = 2
"""Number of levels that a slice of prediction trees adds to the sum (`MAX_LEVELS`)."""
MAX_TREE_SLICES = MAX_LEVELS // _LEVELS_OF_TREES
MAX_PARAMETER_BYTES = 1 << 16
"""Maximum number of bytes of parameter sets and tile inventories; their parsing is slow."""

_MAX_ORIGIN = 1 << 31
_MAX_DENOMINATOR = 1 << 16

_PARAMETERS = {
    syntax.SEQUENCE_PARAMETER_SET,
    syntax.GEOMETRY_PARAMETER_SET,
    syntax.ATTRIBUTE_PARAMETER_SET,
    syntax.TILE_INVENTORY,
}

# Which coded axis (s, t, v) is x, y, z, by geom_axis_order.
_AXIS_ORDERS = (
    *((2, 1, 0), (0, 1, 2), (0, 2, 1), (2, 0, 1)),
    *((2, 1, 0), (1, 2, 0), (1, 0, 2), (0, 1, 2)),
)


@dataclass(frozen=True)
class DecodedGeometry:
    """The points of a decoded stream, on an integer grid in the cloud's coordinates.

    Attributes
    ----------
    points
        Integer coordinates (m, 3) in steps of the grid. Equal points may occur several times.
    scale
        Number of grid steps per unit of the cloud's coordinates.
    origin
        Origin of the grid, in grid steps.
    global_scale
        Additional factor of `points` that the stream states; it is 1 in streams of this encoder.
    metres
        Whether the unit of the cloud's coordinates is the metre. If not, the unit is unknown.
    """

    points: Ints
    scale: Fraction
    origin: tuple[int, int, int]
    global_scale: Fraction = Fraction(1)
    metres: bool = False

    def positions(self) -> NDArray[np.float64]:
        """Return the points in the cloud's coordinates, as an array (m, 3) of float64.

        A position is ``(points * global_scale + origin) / scale``, and equals TMC13's bit for bit.
        """
        step = self.scale.denominator / self.scale.numerator
        corner = np.array(self.origin, dtype=np.float64) * step
        positions = self.points.astype(np.float64)
        positions *= float(self.global_scale.numerator)
        positions *= step / self.global_scale.denominator
        positions += corner
        return positions


@dataclass(frozen=True)
class CodedPoints:
    """The points of an encoded slice, and the points of the input that they stand for."""

    points: SlicePoints
    # (n,) indices of the slice's points in the input.
    members: NDArray[np.int64]
    # (n,) `members` in coded order, or None if equal points are merged.
    rows: NDArray[np.int64] | None


def encode_geometry(
    points: NDArray[Any],
    options: GpccOptions = PROFILES["ctc"],
    scale: Fraction | float = 1,
    origin: Sequence[int] | Ints = (0, 0, 0),
    sensor: SensorDescription | None = None,
    attributes: AttributeEncoder | None = None,
) -> bytes:
    """Encode points with an octree as a G-PCC stream of one frame, which TMC13 can decode.

    Parameters
    ----------
    points
        Integer coordinates (n, 3) in steps of the grid, as `quantise` returns them. They may be in
        any order, and negative.
    options
        Coding tools. The default, `PROFILES["ctc"]`, keeps one of several equal points.
    scale
        Number of grid steps per unit of the cloud's coordinates. The stream states it for the
        decoder.
    origin
        Integer origin (3,) of the grid, in grid steps. A decoder returns ``(points + origin) /
        scale``.
    sensor
        A rotating sensor in the coordinates ``points + origin``. If it is given, the octree is
        coded in angular mode, which predicts points from the directions of the sensor's beams.
    attributes
        Encoder of the points' attributes. Callers use `encode_cloud` instead.

    Returns
    -------
    bytes
        The stream, for `decode_geometry`.

    Raises
    ------
    InputError
        There are no points, coordinates are not integers or span more than 21 bits, points are more
        than 16,777,216, or the sensor is too far away.
    """
    points, low = checked_points(points)
    corner = tuple(int(a) + int(b) for a, b in zip(low, origin, strict=True))
    sps = sequence_parameter_set(corner, scale)
    gps = _geometry_parameter_set(options)
    if sensor is not None:
        gps = replace(gps, **sensor.syntax_elements(corner))
        gps.planar_buffer_disabled_flag = int(options.planar and not options.planar_buffer)
    rows = None if attributes is None else np.arange(len(points))
    slices = list(_partition(points, low, options, sensor is not None, rows))
    if (
        sum(slice_points.coded_points(options.merge_duplicates) for slice_points in slices)
        > MAX_POINTS
    ):
        raise InputError(f"G-PCC: more than {MAX_POINTS} points")
    if sum(len(slice_points.axes) for slice_points in slices) > MAX_LEVELS:
        raise InputError(f"G-PCC: {len(slices)} slices have more than {MAX_LEVELS} octree levels")
    parameters = []
    if attributes is not None:
        extent = (bounding_corners(points)[1] - low).tolist()
        parameters = attributes.start(sps, gps, extent)
    axes, merged = _AXIS_ORDERS[sps.geom_axis_order], bool(gps.geom_unique_points_flag)

    def units_of(number: int) -> Units:
        part = slices[number]
        header = _geometry_header(part, number)
        if attributes is None:
            return [_geometry_unit(part, header, sps, gps)]

        def geometry(leaves: Ints | None = None) -> Units:
            return [_geometry_unit(part, header, sps, gps, leaves)]

        def values(leaves: Ints | None = None) -> Units:
            codes, rows = _coded_order(part, low, merged, leaves)
            sensor = sensor_position(header, gps, axes, part.corner)
            coded = CodedPoints(octree_points(gps, axes, sensor, codes), part.members, rows)
            return attributes.data_units(number, part.corner, coded)

        if gps.inferred_direct_coding_mode:  # the coding decides the order of the points
            leaves = np.empty(part.coded_points(merged), dtype=np.int64)
            return geometry(leaves) + values(leaves)
        first, others = in_threads(lambda units: units(), (geometry, values))
        return first + others

    return stream_of(sps, gps, in_threads(units_of, range(len(slices))), parameters)


def _coded_order(
    part: _SlicePoints, low: Ints, merged: bool, coded: Ints | None
) -> tuple[Ints, NDArray[np.int64] | None]:
    """Return Morton codes of a slice's points in coded order, and their indices in the input."""
    # coded: the codes, or None if the points have the octree's order. Merged points have no index.
    codes, rows = leaf_codes(part.tree, part.axes), None
    if not merged:
        codes = np.repeat(codes, part.tree.counts)
        corner = low + np.array(part.corner)
        rows = part.members[sorted_rows(part.points, corner, part.axes, part.tree)]
    if coded is None:
        return codes, rows
    if rows is not None:
        along_tree = rows[np.argsort(codes, kind="stable")]
        rows = np.empty_like(along_tree)
        rows[np.argsort(coded, kind="stable")] = along_tree
    return coded, rows


def octree_points(
    gps: syntax.GeometryParameterSet, axes: Three, sensor: Three, codes: Ints
) -> SlicePoints:
    relative = morton_points(codes, np.arange(3), np.zeros(3, dtype=np.int64))
    return SlicePoints(gps, axes, sensor, relative.astype(np.int32), codes)


def checked_points(points: NDArray[Any]) -> tuple[Ints, Ints]:
    """Return points as int64 (n, 3), and their least coordinates (3,).

    Raises
    ------
    InputError
        There are no points, they have another shape, or they are not integers within 21 bits.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"G-PCC: expected points of shape (n, 3), got {points.shape}")
    if not len(points):
        raise InputError("G-PCC: no points to code")
    whole = np.ascontiguousarray(points, dtype=np.int64)
    if points.dtype.kind not in "iu" and not (whole == points).all():
        raise InputError("G-PCC: coordinates are not integers: scale and round them first")
    points = whole
    low, high = bounding_corners(points)
    if (high - low >= 1 << MOST_BITS).any():
        raise InputError(f"G-PCC: points are more than {MOST_BITS} bits apart")
    return points, low


def stream_of(
    sps: syntax.SequenceParameterSet,
    gps: syntax.GeometryParameterSet,
    slices: Iterable[Units],
    attribute_parameters: Iterable[bytes],
) -> bytes:
    payloads = [
        (syntax.SEQUENCE_PARAMETER_SET, syntax.written(syntax.sequence_parameter_set, sps)),
        (syntax.GEOMETRY_PARAMETER_SET, syntax.written(syntax.geometry_parameter_set, gps)),
        *((syntax.ATTRIBUTE_PARAMETER_SET, payload) for payload in attribute_parameters),
        *(unit for units in slices for unit in units),
    ]
    return b"".join(syntax.encapsulate(kind, payload) for kind, payload in payloads)


def sequence_parameter_set(
    origin: tuple[int, ...], scale: Fraction | float
) -> syntax.SequenceParameterSet:
    scale = Fraction(scale).limit_denominator(_MAX_DENOMINATOR)
    if max(map(abs, origin)) >= _MAX_ORIGIN or not 0 < scale.numerator < _MAX_ORIGIN:
        raise InputError("G-PCC: the origin or the scale is too large for a stream")
    x, y, z = origin
    return syntax.SequenceParameterSet(
        seq_origin_bits=bits_of(max(map(abs, origin))),
        seq_origin_xyz=(x, y, z),
        seq_unit_numerator_minus1=scale.numerator - 1,
        seq_unit_denominator_minus1=scale.denominator - 1,
    )


def bits_of(value: int) -> int:
    return max(value.bit_length(), 1)


def _geometry_parameter_set(options: GpccOptions) -> syntax.GeometryParameterSet:
    boundary = max(options.neighbour_avail_boundary_log2 - 1, 0)
    first, second, third = options.planar_thresholds
    mode = options.inferred_direct_coding_mode
    if mode == 1 and options.planar_mode_idcm_use == 0:
        mode = 0
    return syntax.GeometryParameterSet(
        geom_unique_points_flag=int(options.merge_duplicates),
        inferred_direct_coding_mode=mode,
        joint_2pt_idcm_enabled_flag=int(options.joint_two_point_idcm),
        qtbt_enabled_flag=int(options.qtbt),
        neighbour_avail_boundary_log2_minus1=boundary,
        adjacent_child_contextualization_enabled_flag=int(
            boundary > 0 and options.adjacent_child_contextualization
        ),
        intra_pred_max_node_size_log2=options.intra_pred_max_node_size_log2 if boundary else 0,
        geom_planar_mode_enabled_flag=int(options.planar),
        geom_planar_threshold0=first,
        geom_planar_threshold1=second,
        geom_planar_threshold2=third,
        geom_idcm_rate_minus1=options.planar_mode_idcm_use - 1 if mode == 1 else 31,
        gps_extension_flag=1,  # as in TMC13 for streams without a profile
    )


def _partition(
    points: Ints,
    start: Ints,
    options: GpccOptions,
    angular: bool,
    rows: NDArray[np.int64] | None,
) -> Iterator[_SlicePoints]:
    # rows: (n,) indices of the points, or None if `_SlicePoints.members` may be empty.
    fits = len(points) <= options.slice_max_points
    if fits or options.merge_duplicates:
        slice_points = _slice_points(points, start, options, angular, rows)
        if fits or len(slice_points.tree.keys) <= options.slice_max_points:
            yield slice_points
            return
    lowest, highest = bounding_corners(points)
    axis = int(np.argmax(highest - lowest))
    values = points[:, axis] - lowest[axis]
    order = sort_keys(values)
    middle = split_position(values)
    for part in (order[:middle], order[middle:]):
        members = None if rows is None else rows[part]
        yield from _partition(points[part], start, options, angular, members)


def split_position(sorted_values: NDArray[Any]) -> int:
    """Return the index near the middle at which to split sorted values.

    If possible, equal values are not separated.
    """
    middle = len(sorted_values) // 2
    starts = np.searchsorted(sorted_values, sorted_values[middle], side="left")
    ends = np.searchsorted(sorted_values, sorted_values[middle], side="right")
    if starts == 0 and ends == len(sorted_values):
        return middle
    return int(starts if starts > 0 else ends)


@dataclass(frozen=True)
class _SlicePoints:
    corner: tuple[int, int, int]
    axes: list[int]
    tree: Tree
    points: Ints
    members: NDArray[np.int64]

    def coded_points(self, merged: int) -> int:
        return len(self.tree.keys) if merged else int(self.tree.counts.sum())


def _slice_points(
    points: Ints,
    start: Ints,
    options: GpccOptions,
    angular: bool,
    rows: NDArray[np.int64] | None,
) -> _SlicePoints:
    low, high = bounding_corners(points)
    x, y, z = (max(int(size).bit_length(), 1) for size in high - low)
    late_z = (
        options.angular_max_node_min_dim_log2_to_split_z,
        options.angular_max_diff_to_split_z,
    )
    axes = coded_axes(
        (x, y, z),
        options.qtbt,
        options.max_num_qtbt_before_ot,
        options.min_qtbt_size_log2,
        late_z if angular else None,
    )
    a, b, c = (low - start).tolist()
    ordered = angular and options.inferred_direct_coding_mode > 0
    tree = build_tree(points, low, axes, ordered, options.merge_duplicates)
    if rows is None:
        points, rows = points[:0], np.empty(0, np.int64)
    return _SlicePoints((a, b, c), axes, tree, points, rows)


def _geometry_header(part: _SlicePoints, number: int) -> syntax.GeometryHeader:
    return syntax.GeometryHeader(
        slice_id=number,
        slice_geom_origin_bits_minus1=bits_of(max(part.corner)) - 1,
        slice_geom_origin_xyz=part.corner,
        tree_depth_minus1=len(part.axes) - 1,
        tree_lvl_coded_axis_list=part.axes,
    )


def _geometry_unit(
    part: _SlicePoints,
    header: syntax.GeometryHeader,
    sps: syntax.SequenceParameterSet,
    gps: syntax.GeometryParameterSet,
    leaves: Ints | None = None,
) -> tuple[int, bytes]:
    sensor = sensor_state(header, gps, _AXIS_ORDERS[sps.geom_axis_order], part.corner)
    data = encode_octree(part.tree, header, gps, sensor, leaves)
    coded = CodedSlice(header, data, part.coded_points(gps.geom_unique_points_flag))
    return syntax.GEOMETRY_DATA_UNIT, data_unit(coded, sps, gps)


def decode_geometry(stream: bytes, attributes: AttributeReader | None = None) -> DecodedGeometry:
    """Decode the points of a G-PCC stream that holds one frame.

    Parameters
    ----------
    stream
        A bare stream, as `encode_geometry`, `encode_predictive_geometry` and TMC13 write it.
    attributes
        Decoder of the attributes. By default, attributes are skipped; use `decode_cloud` to decode
        them.

    Returns
    -------
    DecodedGeometry
        Integer points with their scale and origin. The method `positions` applies scale and origin.

    Raises
    ------
    InputError
        The stream is damaged, or uses a tool that this decoder does not support.
    """
    contents = _StreamReader(attributes)
    for payload_type, payload in syntax.payloads(stream):
        contents.take(payload_type, payload)
    return contents.geometry()


class _SliceUnits(NamedTuple):
    coded: CodedSlice
    sps: syntax.SequenceParameterSet
    gps: syntax.GeometryParameterSet
    attribute_units: Units


class _StreamReader:
    def __init__(self, attributes: AttributeReader | None) -> None:
        self._attributes = attributes
        self._sps: dict[int, syntax.SequenceParameterSet] = {}
        self._gps: dict[int, syntax.GeometryParameterSet] = {}
        self._active: syntax.SequenceParameterSet | None = None
        self._frame: int | None = None
        self._runs: list[list[_SliceUnits]] = []  # each shares entropy contexts
        self._branches: list[AttributeReader | None] = []  # one for each run
        self._points = self._levels = self._parameter_bytes = 0

    def take(self, payload_type: int, payload: bytes) -> None:
        if payload_type in _PARAMETERS:
            self._parameter_bytes += len(payload)
            if self._parameter_bytes > MAX_PARAMETER_BYTES:
                raise InputError(f"G-PCC stream: more than {MAX_PARAMETER_BYTES} parameter bytes")
        if payload_type == syntax.SEQUENCE_PARAMETER_SET:
            sps = syntax.SequenceParameterSet()
            syntax.sequence_parameter_set(BitReader(payload), sps)
            self._sps.setdefault(sps.sps_seq_parameter_set_id, sps)
        elif payload_type == syntax.GEOMETRY_PARAMETER_SET:
            gps = syntax.GeometryParameterSet()
            syntax.geometry_parameter_set(BitReader(payload), gps)
            syntax.check_tools(gps)
            self._gps.setdefault(gps.gps_geom_parameter_set_id, gps)
        elif payload_type == syntax.GEOMETRY_DATA_UNIT:
            self._start_slice(payload)
        elif self._attributes is not None:
            if self._runs:
                self._runs[-1][-1].attribute_units.append((payload_type, payload))
            if not self._runs or payload_type == syntax.ATTRIBUTE_PARAMETER_SET:
                self._attributes.take(payload_type, payload)

    def _start_slice(self, payload: bytes) -> None:
        if not payload:
            raise InputError("G-PCC stream: an empty geometry data unit")
        gps = self._gps.get(payload[0] >> 4)
        sps = self._sps.get(gps.gps_seq_parameter_set_id) if gps else None
        if gps is None or sps is None:
            raise InputError("G-PCC stream: a slice without its parameter sets")
        if self._active is not None and sps is not self._active:
            raise InputError("G-PCC stream: slices of different sequences")
        self._active = sps
        coded = read_slice(payload, sps, gps)
        self._points += coded.points
        self._levels += len(coded.header.tree_lvl_coded_axis_list) or _LEVELS_OF_TREES
        if self._points > MAX_POINTS:
            raise InputError(f"G-PCC stream: more than {MAX_POINTS} points")
        if self._levels > MAX_LEVELS:
            raise InputError(f"G-PCC stream: more than {MAX_LEVELS} octree levels in its slices")
        self._check_single_frame(coded)
        if self._attributes is not None:
            self._attributes.expect(sps, coded.points)
        if not self._runs or not coded.header.entropy_continuation_flag:
            self._runs.append([])
            self._branches.append(self._attributes and self._attributes.branch())
        self._runs[-1].append(_SliceUnits(coded, sps, gps, []))

    def _decoded(self, run: list[_SliceUnits], attributes: AttributeReader | None) -> list[Ints]:
        contexts, probabilities, decoded = initial_contexts(), initial_probabilities(), []
        for coded, sps, gps, attribute_units in run:
            axes, origin = _AXIS_ORDERS[sps.geom_axis_order], _slice_origin(coded.header, gps)
            sensor = sensor_position(coded.header, gps, axes, origin)
            if gps.geom_tree_type == syntax.PREDICTIVE:
                nodes = decode_trees(coded, sps, gps, probabilities, axes, origin)
                points = SlicePoints(gps, axes, sensor, nodes.points, spherical=nodes.positions)
                decoded.append(placed(nodes.points, axes, origin))
            else:
                state = sensor_state(coded.header, gps, axes, origin)
                codes = decode_slice(coded, sps, gps, contexts, state)
                if attributes is not None:
                    points = octree_points(gps, axes, sensor, codes)
                decoded.append(morton_points(codes, np.array(axes), np.array(origin)))
            if attributes is not None:
                attributes.start_slice(sps, coded.header, points)
                for payload_type, payload in attribute_units:
                    attributes.take(payload_type, payload)
        return decoded

    def _check_single_frame(self, coded: CodedSlice) -> None:
        frame = coded.header.frame_ctr_lsb
        if self._frame is not None and frame != self._frame:
            raise InputError("G-PCC stream: more than one frame")
        self._frame = frame

    def geometry(self) -> DecodedGeometry:
        sps = self._active
        if sps is None:
            raise InputError("G-PCC stream: no geometry")
        pairs = zip(self._runs, self._branches, strict=True)
        runs = in_threads(lambda pair: self._decoded(*pair), pairs)
        parts = [points for run in runs for points in run]
        points = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return DecodedGeometry(
            points=points,
            scale=Fraction(sps.seq_unit_numerator_minus1 + 1, sps.seq_unit_denominator_minus1 + 1),
            origin=_scaled_origin(sps.seq_origin_xyz, sps.seq_origin_log2_scale),
            global_scale=_global_scale(sps),
            metres=bool(sps.seq_unit_is_metres_flag),
        )


def _slice_origin(header: syntax.GeometryHeader, gps: syntax.GeometryParameterSet) -> Three:
    present = gps.slice_geom_origin_scale_present
    scale = header.slice_geom_origin_log2_scale if present else gps.gps_geom_origin_log2_scale
    return _scaled_origin(header.slice_geom_origin_xyz, scale)


def _scaled_origin(origin: Three, log2_scale: int) -> Three:
    x, y, z = (v << min(log2_scale, 64) for v in origin)
    if max(abs(x), abs(y), abs(z)) >= _MAX_ORIGIN:
        raise InputError("G-PCC stream: the origin is too large")
    return x, y, z


def _global_scale(sps: syntax.SequenceParameterSet) -> Fraction:
    bits = sps.seq_global_scale_refinement_num_bits
    if max(bits, sps.seq_global_scale_factor_log2) > 30:
        raise InputError("G-PCC stream: the scale is too large")
    refined = Fraction((1 << bits) + sps.seq_global_scale_refinement_factor, 1 << bits)
    return refined * (1 << sps.seq_global_scale_factor_log2)
