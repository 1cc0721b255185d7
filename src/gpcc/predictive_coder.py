from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gpcc import syntax
from gpcc.attributes.geometry import SlicePoints
from gpcc.coder import (
    MAX_POINTS,
    MAX_TREE_SLICES,
    CodedPoints,
    Units,
    bits_of,
    checked_points,
    sequence_parameter_set,
    split_position,
    stream_of,
)
from gpcc.prediction_tree import Order, angular_tree, nearest_tree, ordered
from gpcc.predictive import MOST_QP, Tools, initial_probabilities, quantised
from gpcc.predictive_slices import encode_trees, tools_of
from gpcc.sensor import SensorDescription
from gpcc.slices import CodedSlice, data_unit, sensor_position
from gpcc.syntax import Three
from pointkit.errors import InputError
from pointkit.geometry.morton import MOST_BITS, Ints
from pointkit.models import Model
from pointkit.threads import in_threads

if TYPE_CHECKING:
    from gpcc.attributes.writer import AttributeEncoder

_AXES = (0, 1, 2)
_WIDEST = (5, 5, 5)


class PredictiveOptions(Model):
    """Options of the encoder of prediction trees.

    The encoder predicts each point from up to three points coded before, and codes the difference.
    Steps of azimuth and radius only apply if the encoder is given a sensor.
    """

    order: Order = Field(
        "azimuth", description="order of the points in trees: that of the input, or sorted"
    )
    azimuth_sort_precision: float = Field(
        1024.0,
        ge=0,
        description="azimuth steps per radian; points within a step are sorted by radius",
    )
    azimuth_scale_log2: int = Field(
        12, ge=0, le=18, description="log2 of the azimuth steps per turn, minus 12"
    )
    azimuth_speed: int | None = Field(
        None, ge=1, description="azimuth steps between two firings; by default those of the sensor"
    )
    radius_inv_scale_log2: int = Field(
        0, ge=0, le=20, description="log2 of the coding units in a step of the radius"
    )
    azimuth_scaling: bool = Field(
        True, description="code residuals of the azimuth as arc lengths instead of angles"
    )
    base_qp: int | None = Field(
        None, ge=0, le=MOST_QP, description="quantisation parameter (QP) of residuals in x, y, z"
    )
    qp_multiplier_log2: int = Field(0, ge=0, le=3, description="log2 of the factor of QPs")
    qp_interval_log2: int = Field(
        8, ge=0, le=30, description="log2 of the number of nodes between two QP offsets"
    )
    slice_qp_interval_log2: int | None = Field(
        None, ge=0, le=30, description="the same for a slice; by default that of the stream"
    )
    tree_max_points: int = Field(
        default=1_100_000, ge=1, description="maximum number of points in a tree"
    )
    merge_duplicates: bool = Field(default=False, description="keep one of several equal points")
    slice_max_points: int = Field(
        default=1_100_000, ge=1, le=1 << 24, description="maximum number of points in a slice"
    )


DEFAULT_OPTIONS = PredictiveOptions()


def encode_predictive_geometry(
    points: NDArray[Any],
    options: PredictiveOptions = DEFAULT_OPTIONS,
    scale: Fraction | float = 1,
    origin: Sequence[int] | Ints = (0, 0, 0),
    sensor: SensorDescription | None = None,
    attributes: AttributeEncoder | None = None,
) -> bytes:
    """Encode points with prediction trees as a G-PCC stream of one frame, which TMC13 can decode.

    With a sensor, points are predicted along each laser's ring, in radius, azimuth and laser index.
    Without one, each point is predicted from near points coded before. Equal points are kept unless
    `options` merge them. The other parameters, the result and the errors are those of
    `encode_geometry`.
    """
    points, low = checked_points(points)
    whole, first_of = points, np.empty(0, dtype=np.int64)
    if options.merge_duplicates:
        _, first, of_unique = np.unique(points, axis=0, return_index=True, return_inverse=True)
        first_of = first[of_unique.ravel()]
        points = points[np.sort(first)]
    if len(points) > MAX_POINTS:
        raise InputError(f"G-PCC: more than {MAX_POINTS} points")
    corner = tuple(int(a) + int(b) for a, b in zip(low, origin, strict=True))
    sps = sequence_parameter_set(corner, scale)
    gps = _geometry_parameter_set(options, sensor, corner)
    centre = _centre(sensor, corner)
    relative = (points - low).astype(np.int32)
    parts = list(_partition(relative, np.arange(len(points)), options.slice_max_points))
    if len(parts) > MAX_TREE_SLICES:
        raise InputError(f"G-PCC: more than {MAX_TREE_SLICES} slices")
    sources = np.unique(first_of) if options.merge_duplicates else np.arange(len(points))
    del points

    def units_of(number: int) -> Units:
        rows = parts[number]
        part = _coded_part(relative[rows], number, options, sps, gps, centre)
        geometry = (syntax.GEOMETRY_DATA_UNIT, part.unit)
        if attributes is None:
            return [geometry]
        members, coded_rows = sources[rows], None
        if options.merge_duplicates:
            members = np.flatnonzero(np.isin(first_of, members))
        else:
            coded_rows = members[part.rows]
        coded = CodedPoints(part.points, members, coded_rows)
        return [geometry, *attributes.data_units(number, part.corner, coded)]

    parameters = []
    if attributes is not None:
        parameters = attributes.start(sps, gps, (whole.max(axis=0) - low).tolist())
    return stream_of(sps, gps, in_threads(units_of, range(len(parts))), parameters)


def _centre(sensor: SensorDescription | None, corner: tuple[int, ...]) -> Three:
    x, y, z = (a - b for a, b in zip(sensor.position if sensor else (0, 0, 0), corner, strict=True))
    if sensor and max(map(abs, (x, y, z))) >= 1 << (MOST_BITS + 1):
        raise InputError(f"G-PCC: the sensor is more than {MOST_BITS} bits away from its points")
    return x, y, z


def _geometry_parameter_set(
    options: PredictiveOptions, sensor: SensorDescription | None, corner: tuple[int, ...]
) -> syntax.GeometryParameterSet:
    angular: dict[str, Any] = {}
    if sensor is not None:
        turn = 1 << (12 + options.azimuth_scale_log2)
        speed = options.azimuth_speed or max(round(turn / sensor.steps_per_turn), 1)
        if speed > turn:
            raise InputError(f"G-PCC: the azimuth's speed {speed} is more than a turn")
        angular = {
            **sensor.syntax_elements(corner),
            "geom_angular_azimuth_scale_log2_minus11": options.azimuth_scale_log2,
            "geom_angular_azimuth_speed_minus1": speed - 1,
            "geom_angular_radius_inv_scale_log2": options.radius_inv_scale_log2,
            "azimuth_scaling_enabled_flag": int(options.azimuth_scaling),
        }
    return syntax.GeometryParameterSet(
        geom_unique_points_flag=int(options.merge_duplicates),
        geom_tree_type=syntax.PREDICTIVE,
        **angular,
        geom_scaling_enabled_flag=int(options.base_qp is not None),
        geom_base_qp=options.base_qp or 0,
        geom_qp_multiplier_log2=options.qp_multiplier_log2 if options.base_qp is not None else 0,
        geom_qp_offset_intvl_log2=options.qp_interval_log2,
        gps_extension_flag=1,  # as in TMC13 for streams without a profile
    )


def _partition(
    points: NDArray[np.int32], rows: NDArray[np.int64], most: int
) -> Iterator[NDArray[np.int64]]:
    if len(rows) <= most:
        yield rows
        return
    part = points[rows]
    values = part[:, int(np.argmax(np.ptp(part, axis=0)))]
    middle = values[np.argsort(values, kind="stable")]
    below = values < middle[split_position(middle)]
    if not below.any():  # all values are equal
        below = np.arange(len(rows)) < len(rows) // 2
    yield from _partition(points, rows[below], most)
    yield from _partition(points, rows[~below], most)


class _CodedPart(NamedTuple):
    unit: bytes
    corner: Three
    points: SlicePoints
    rows: NDArray[np.int64]


def _coded_part(
    points: NDArray[np.int32],
    number: int,
    options: PredictiveOptions,
    sps: syntax.SequenceParameterSet,
    gps: syntax.GeometryParameterSet,
    centre: Three,
) -> _CodedPart:
    x, y, z = points.min(axis=0).tolist()
    rows = _order(points, options, centre)
    points = points[rows] - np.array((x, y, z), dtype=np.int32)
    interval = options.slice_qp_interval_log2
    delta = 0 if interval is None else (interval - options.qp_interval_log2) % (1 << 32)
    header = syntax.GeometryHeader(
        slice_id=number,
        slice_geom_origin_bits_minus1=bits_of(max(x, y, z)) - 1,
        slice_geom_origin_xyz=(x, y, z),
        geom_qp_offset_intvl_log2_delta=delta,
    )
    data, coded, positions, order = _coded(points, header, gps, options.tree_max_points)
    sensor = sensor_position(header, gps, _AXES, (x, y, z))
    spherical = positions[order] if gps.geom_angular_mode_enabled_flag else None
    return _CodedPart(
        data_unit(CodedSlice(header, data, len(points)), sps, gps),
        (x, y, z),
        SlicePoints(gps, _AXES, sensor, coded[order], spherical=spherical),
        rows[order],
    )


def _order(points: NDArray[np.int32], options: PredictiveOptions, centre: Three) -> Ints:
    most, precision = options.tree_max_points, options.azimuth_sort_precision
    return np.concatenate(
        [
            start + ordered(points[start : start + most], options.order, centre, precision)
            for start in range(0, len(points), most)
        ]
    )


def _coded(
    points: NDArray[np.int32],
    header: syntax.GeometryHeader,
    gps: syntax.GeometryParameterSet,
    most: int,
) -> tuple[bytes, NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    tools = tools_of(header, gps, _AXES, header.slice_geom_origin_xyz)
    positions = np.empty_like(points) if tools.angular else points
    if tools.angular:
        tree = angular_tree(points, tools.sphere, positions, most)
        header.pgeom_min_radius = int(positions[:, 0].min()) if len(points) <= most else 0
    else:
        tree = nearest_tree(points, most)
    for widths in (_residual_bits(points, tools), _WIDEST):
        header.pgeom_resid_abs_log2_bits = widths
        tools = tools_of(header, gps, _AXES, header.slice_geom_origin_xyz)
        coded = points.copy()
        coded_positions = positions.copy() if tools.angular else coded
        order = np.empty(len(points), dtype=np.int32)
        data = encode_trees(tree, coded, coded_positions, tools, initial_probabilities(), order)
        if data is not None:
            return data, coded, coded_positions, order
    raise InputError("G-PCC: residuals are too large for a stream")


def _residual_bits(points: NDArray[np.int32], tools: Tools) -> Three:
    """Return how many bits state the bit length of a residual along each axis."""
    sides = [max(int(side).bit_length(), 1) for side in points.max(axis=0)]
    if tools.angular:
        return _angular_residual_bits(sides, tools)
    widths = [quantised((1 << side) - 1, tools.slice_qp) for side in sides]
    x, y, z = (bits_of(_ceil_log2(max(1, width))) for width in widths)
    return x, y, z


def _angular_residual_bits(sides: list[int], tools: Tools) -> Three:
    around = tools.sphere
    far = [
        max(abs(around.origin[k]), abs((1 << sides[k]) - 1 - around.origin[k])) for k in range(2)
    ]
    radius = math.floor(math.hypot(*far) + 0.5)
    steps = _divided(radius, around.radius_log2)
    turned = tools.azimuth_speed >> 1
    if tools.azimuth_scaling:
        arc = (turned + 1) * _divided(radius << 3, around.radius_log2)
        turned = _divided(arc, around.azimuth_log2)
    most = (steps, turned, len(around.theta) - 1)
    x, y, z = (_ceil_log2(value).bit_length() for value in most)
    return x, y, z


def _divided(value: int, shift: int) -> int:
    return (value + ((1 << shift) >> 1)) >> shift


def _ceil_log2(value: int) -> int:
    return (value - 1).bit_length() if value else 32  # as in TMC13
