from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes import lifting, prediction, raht
from gpcc.attributes import syntax as attribute_syntax
from gpcc.attributes.colours import BT709, IDENTITY, YCGCO, Values, coded_colours, coded_values
from gpcc.attributes.geometry import SlicePoints
from gpcc.attributes.options import AttributeOptions
from gpcc.attributes.quantisation import FRACTION_BITS, qps, quantisers
from gpcc.attributes.reader import COLOUR, REFLECTANCE, prediction_tools
from gpcc.attributes.residuals import encode_coefficients, initial_probabilities
from gpcc.attributes.syntax import (
    BY_DISTANCE,
    CENTROID,
    LIFTING,
    PERIODIC,
    PREDICTING,
    RAHT,
    SKIP_ALL_LAYERS,
    AttributeHeader,
    AttributeParameterSet,
)
from gpcc.coder import CodedPoints
from gpcc.kd_tree import Int32s
from gpcc.syntax import (
    ATTRIBUTE_DATA_UNIT,
    PREDICTIVE,
    AttributeDescription,
    GeometryParameterSet,
    SequenceParameterSet,
    Three,
    written,
)
from pointkit.errors import InputError

Recolour = Callable[[Values, CodedPoints, Three, int], Values]

_LABELS = {"color": COLOUR, "reflectance": REFLECTANCE}
_MATRICES = {"identity": IDENTITY, "bt709": BT709, "ycgco": YCGCO}
_ENCODINGS = {"raht": RAHT, "predicting": PREDICTING, "lifting": LIFTING}
_DECIMATIONS = {"distance": BY_DISTANCE, "periodic": PERIODIC, "centroid": CENTROID}
_FULL_RANGE = 1_100_000
_TURN = 25735
_MOST_LOG2 = 21
_ESTIMATE_PERIOD, _ESTIMATE_RANGE = 100, 128
_MOST_DISTANCE_LOG2 = 20


class AttributeEncoder:
    """Encoder of the attributes of a cloud, which the encoder of the positions calls.

    Parameters
    ----------
    attributes, options
        Values and options by attribute name, as in `encode_cloud`.
    count
        Number of points of the input.
    recolour
        Function that returns the values of merged points.

    Raises
    ------
    InputError
        An attribute has another name, shape or range than its options allow.
    """

    def __init__(
        self,
        attributes: Mapping[str, NDArray[Any]],
        options: Mapping[str, AttributeOptions],
        count: int,
        recolour: Recolour,
    ) -> None:
        self._names = list(attributes)
        self._options = [options[name] for name in self._names]
        self._described = [
            _description(name, each) for name, each in zip(self._names, self._options, strict=True)
        ]
        self._values = [
            _checked(name, values, described, count)
            for (name, values), described in zip(attributes.items(), self._described, strict=True)
        ]
        self._parameters: list[AttributeParameterSet] = []
        self._recolour = recolour

    def start(
        self, sps: SequenceParameterSet, gps: GeometryParameterSet, extent: Sequence[int]
    ) -> list[bytes]:
        """Describe the attributes in the sequence parameter set, and return their parameter sets.

        Parameters
        ----------
        sps
            Sequence parameter set, to which descriptions of the attributes are added.
        gps
            Parameter set of the geometry.
        extent
            Largest x, y and z of the points, relative to the sequence's origin.

        Returns
        -------
        list of bytes
            One parameter set for each attribute.
        """
        sps.attributes, sps.num_attributes = self._described, len(self._described)
        self._parameters = [
            _parameter_set(index, options, gps, extent)
            for index, options in enumerate(self._options)
        ]
        return [written(attribute_syntax.attribute_parameter_set, aps) for aps in self._parameters]

    def data_units(
        self, slice_id: int, origin: Three, coded: CodedPoints
    ) -> list[tuple[int, bytes]]:
        """Encode the attributes of a slice.

        Parameters
        ----------
        slice_id
            Number of the slice.
        origin
            Origin of the slice.
        coded
            The points of the slice, as they were coded.

        Returns
        -------
        list of (int, bytes)
            The payload type and the payload of each attribute's data unit.
        """
        units = []
        for index in sorted(range(len(self._names)), key=self._names.__getitem__):
            values = self._values[index]
            if coded.rows is None:
                values = self._recolour(
                    values, coded, origin, self._described[index].attr_bitdepth_minus1 + 1
                )
            else:
                values = values[coded.rows]
            payload = self._data_unit(index, slice_id, coded.points, values)
            units.append((ATTRIBUTE_DATA_UNIT, payload))
        return units

    def _data_unit(self, index: int, slice_id: int, points: SlicePoints, values: Values) -> bytes:
        aps, options = self._parameters[index], self._options[index]
        attribute = self._described[index]
        header = AttributeHeader(index, index, slice_id)
        if aps.aps_slice_dist2_deltas_present_flag:
            estimate = estimated_distance_log2(
                points.coordinates(aps), options.dist2_percentile_estimate
            )
            header.attr_dist2_delta = estimate - aps.dist2
        luma, chroma = options.qp_layer_offsets_luma, options.qp_layer_offsets_chroma
        if attribute.attr_components_minus1 == 0:
            chroma = ()
        layers = max(len(luma), len(chroma))
        header.layer_qp_deltas = [
            (_extended(luma, layer), _extended(chroma, layer)) for layer in range(layers)
        ]
        coefficients = encoded_attribute(values, points, aps, header, attribute)
        data = encode_coefficients(coefficients, initial_probabilities())
        return written(attribute_syntax.attribute_header, header, aps, self._described) + data


def _extended(values: Sequence[int], index: int) -> int:
    return values[min(index, len(values) - 1)] if values else 0


def _description(name: str, options: AttributeOptions) -> AttributeDescription:
    if name not in _LABELS:
        raise InputError(f"G-PCC: no attribute '{name}', only {' and '.join(_LABELS)}")
    colour = _LABELS[name] == COLOUR
    bits = options.bitdepth + (colour and options.colour_matrix == "ycgco")
    scaling = (options.attr_scale - 1, 0, options.attr_offset)
    return AttributeDescription(
        attr_components_minus1=2 if colour else 0,
        attr_bitdepth_minus1=bits - 1,
        attr_label=_LABELS[name],
        matrix_coefficients=_MATRICES[options.colour_matrix] if colour else None,
        scaling=scaling if any(scaling) and not colour else None,
    )


def _checked(
    name: str, values: NDArray[Any], attribute: AttributeDescription, count: int
) -> Values:
    components = attribute.attr_components_minus1 + 1
    values = np.asarray(values)
    if values.shape not in ((count, components), (count,) if components == 1 else ()):
        raise InputError(f"G-PCC: '{name}' is not {components} values for each of {count} points")
    whole = values.astype(np.int32).reshape(count, components)
    bits = attribute.attr_bitdepth_minus1 + 1
    ycgco = attribute.matrix_coefficients == YCGCO
    if attribute.scaling:
        whole = coded_values(whole, attribute.scaling)
    if (whole.reshape(values.shape) != values).any() and not attribute.scaling:
        raise InputError(f"G-PCC: '{name}' has values that are not integers")
    if whole.min(initial=0) < 0 or whole.max(initial=0) >> bits - ycgco:
        below = " after attr_scale, or below attr_offset" if attribute.scaling else ""
        raise InputError(f"G-PCC: '{name}' has values of more than {bits - ycgco} bits{below}")
    if components == 1:
        return whole
    return coded_colours(whole, attribute.matrix_coefficients, bits)


def _parameter_set(
    index: int, options: AttributeOptions, gps: GeometryParameterSet, extent: Sequence[int]
) -> AttributeParameterSet:
    aps = AttributeParameterSet(
        aps_attr_parameter_set_id=index,
        attr_encoding=_ENCODINGS[options.transform],
        init_qp_minus4=options.qp - 4,
        num_pred_nearest_neighbours_minus1=options.number_of_nearest_neighbors_in_prediction - 1,
        aps_extension_flag=1,  # as in TMC13 for streams without a profile
        quant_neigh_weight=list(options.quant_neigh_weight),
        raht_prediction_enabled_flag=int(options.raht_prediction_enabled),
        raht_prediction_threshold0=options.raht_prediction_threshold0,
        raht_prediction_threshold1=options.raht_prediction_threshold1,
    )
    aps.aps_chroma_qp_offset = options.qp_chroma_offset
    if options.spherical_coord and gps.geom_angular_mode_enabled_flag:
        aps.spherical_coord_flag = 1
        aps.attr_coord_scale = _coordinate_scale(gps, extent)
    if aps.has_levels:
        _set_levels(aps, options)
    return aps


def _set_levels(aps: AttributeParameterSet, options: AttributeOptions) -> None:
    aps.num_detail_levels_minus1 = options.level_of_detail_count
    aps.canonical_point_order_flag = int(options.canonical_point_order)
    aps.lod_neigh_bias = options.lod_neigh_bias
    aps.last_component_prediction_enabled_flag = int(options.last_component_prediction)
    aps.lod_decimation_type = _DECIMATIONS[options.lod_decimator]
    periods = options.lod_sampling_period
    if aps.lod_decimation_type != BY_DISTANCE:
        aps.lod_sampling_period = [
            _extended(periods, level) for level in range(aps.num_detail_levels_minus1)
        ]
    if aps.num_detail_levels_minus1:
        aps.dist2 = 0 if aps.lod_decimation_type == PERIODIC else options.dist2
        aps.inter_lod_search_range = _search_range(options.inter_lod_search_range)
        aps.aps_slice_dist2_deltas_present_flag = int(aps.lod_decimation_type == BY_DISTANCE)
    skipped = options.intra_lod_prediction_skip_layers
    if aps.attr_encoding == LIFTING or skipped < 0:
        skipped = SKIP_ALL_LAYERS
    aps.intra_lod_prediction_skip_layers = min(skipped, aps.max_detail_levels + 1)
    if skipped <= aps.max_detail_levels:
        aps.intra_lod_search_range = _search_range(options.intra_lod_search_range)
    if aps.attr_encoding == PREDICTING:
        aps.max_num_direct_predictors = options.max_num_direct_predictors
        aps.adaptive_prediction_threshold = options.adaptive_prediction_threshold
        aps.direct_avg_predictor_disabled_flag = int(options.direct_avg_predictor_disabled)
        aps.inter_component_prediction_enabled_flag = int(options.inter_component_prediction)
        aps.pred_weight_blending_enabled_flag = int(options.pred_weight_blending)


def _search_range(option: int) -> int:
    return _FULL_RANGE if option < 0 else option


def _coordinate_scale(gps: GeometryParameterSet, extent: Sequence[int]) -> list[int]:
    x, y, _ = gps.gps_angular_origin_xyz
    radius = max(abs(x), abs(extent[0] - x), abs(y), abs(extent[1] - y))
    turn = _TURN
    if gps.geom_tree_type == PREDICTIVE:
        turn = 1 << gps.geom_angular_azimuth_scale_log2_minus11 + 12
        radius >>= gps.geom_angular_radius_inv_scale_log2
    widths = [radius + 1, turn + 1, len(gps.lasers)]
    return [(min(max(widths), 1 << _MOST_LOG2) << 8) // width for width in widths]


def estimated_distance_log2(positions: Int32s, percentile: float) -> int:
    """Return log2 of the distance between points that suits the finest level of detail.

    Parameters
    ----------
    positions
        Coordinates (n, 3).
    percentile
        Share, from 0 to below 1, of the points with smaller distances to the nearest point.
    """
    count = len(positions)
    if count < 2:
        return 0
    samples = np.arange(0, count, _ESTIMATE_PERIOD)
    least = np.full(len(samples), np.iinfo(np.int64).max)
    for offset in range(-_ESTIMATE_RANGE, _ESTIMATE_RANGE + 1):
        others = samples + offset
        rows = (others >= 0) & (others < count) & (offset != 0)
        apart = positions[samples[rows]].astype(np.int64) - positions[others[rows]]
        least[rows] = np.minimum(least[rows], (apart * apart).sum(axis=1))
    place = int(np.floor(np.float32(len(samples)) * np.float32(percentile)))
    distance2, log2 = int(np.sort(least)[place]), 0
    while 3 << 2 * log2 < distance2 and log2 < _MOST_DISTANCE_LOG2:
        log2 += 1
    return log2


def encoded_attribute(
    values: Values,
    points: SlicePoints,
    aps: AttributeParameterSet,
    header: AttributeHeader,
    attribute: AttributeDescription,
) -> Values:
    """Return the quantised coefficients (n, components) of a slice's values, in coding order.

    Factors by which components are predicted from each other, if they are used, are written to
    `header`.
    """
    bits = attribute.attr_bitdepth_minus1 + 1
    parameters = qps(aps, header, bits, points.coordinates(aps), points.axes)
    if not aps.has_levels:
        codes, _, indices = points.in_morton_order(aps)
        parameters = parameters.ordered(indices)
        return raht.forward(
            codes, values[indices], parameters, raht.prediction_thresholds(aps)
        ).coefficients
    steps = quantisers(parameters)
    levels = points.levels(aps, header)
    ordered = values[levels.order]
    coefficients = np.empty_like(ordered)
    unused = aps.max_detail_levels - len(levels.ends)
    if aps.attr_encoding == LIFTING:
        weights = lifting.lifting_weights(levels, bool(aps.scalable_lifting_enabled_flag))
        transformed = ordered.astype(np.int64) << FRACTION_BITS
        lifting.transform(levels, weights, transformed, -1)
        factors = np.zeros(len(levels.ends) + 1, dtype=np.int64)
        if aps.last_component_prediction_enabled_flag and values.shape[1] == 3:
            lifting.choose_last_component(transformed, levels.ends, factors)
            chosen = factors[:-1].tolist()
            header.last_component_coeffs = chosen + chosen[-1:] * unused
        lifting.quantise(
            transformed, steps, levels.order, levels.ends, weights, factors, coefficients
        )
        return coefficients
    if aps.inter_component_prediction_enabled_flag and values.shape[1] == 3:
        pairs = np.zeros((aps.max_detail_levels, 2), dtype=np.int64)
        prediction.choose_inter_component(ordered, levels.predictors, levels.ends, pairs)
        header.inter_component_coeffs = [(first, second) for first, second in pairs.tolist()]
    tools, weights = prediction_tools(levels, aps, header, bits)
    coding = (ordered, coefficients, levels.predictors, tools, steps, levels.order, weights)
    prediction.code_values(prediction.Coding(*coding, np.empty((3, 2), dtype=np.int64)))
    return coefficients
