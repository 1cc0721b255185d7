from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpcc import syntax
from gpcc.arithmetic import Probabilities
from gpcc.attributes import lifting, prediction, raht
from gpcc.attributes import syntax as attribute_syntax
from gpcc.attributes.colours import YCGCO, Values, decoded_colours, decoded_values
from gpcc.attributes.geometry import SlicePoints
from gpcc.attributes.levels import Levels, point_weights
from gpcc.attributes.quantisation import FRACTION_BITS, qps, quantisers
from gpcc.attributes.residuals import decode_coefficients, initial_probabilities
from gpcc.attributes.syntax import LIFTING, RAW, AttributeHeader, AttributeParameterSet
from gpcc.bits import BitReader
from gpcc.slices import demultiplexed
from gpcc.syntax import AttributeDescription, GeometryHeader, SequenceParameterSet
from pointkit.errors import InputError

Attribute = NDArray[np.uint8] | NDArray[np.uint16]

MAX_VALUES = 1 << 26
"""Maximum number of attribute values of a stream, which limits the memory."""
MAX_ATTRIBUTES = 16
_RAW_BLOCK = 1 << 16
_HALF = 1 << FRACTION_BITS >> 1
_MOST_BITDEPTH = 16
_MOST_SCALING = 1 << 31
_MOST_FRAC_BITS = 30
_LABELS = (
    *("color", "reflectance", "opacity", "frame_index", "frame_number", "material_id", "normal"),
)
COLOUR, REFLECTANCE = 0, 1
"""Values of attr_label."""


class AttributeReader:
    """Decoder of a stream's attributes.

    The function `decode_geometry` passes the payloads to it in their order.
    """

    def __init__(self) -> None:
        self._aps: dict[int, AttributeParameterSet] = {}
        self._sps: SequenceParameterSet | None = None
        self._contexts: list[Probabilities] = []
        self._values: list[list[Values]] = []
        self._slice: SlicePoints | None = None
        self._slice_id = 0
        self._pending: set[int] = set()
        self._count = 0
        self._branches: list[AttributeReader] = []

    def branch(self) -> AttributeReader:
        """Return a decoder of the next slices, which knows the parameter sets read so far.

        It may run in another thread.
        """
        branch = AttributeReader()
        branch._aps = dict(self._aps)
        self._branches.append(branch)
        return branch

    def expect(self, sps: SequenceParameterSet, count: int) -> None:
        """Add the values of a slice of `count` points, before they are decoded, to a limited total.

        Raises
        ------
        InputError
            Attributes are not supported, or there are too many values.
        """
        if len(sps.attributes) > MAX_ATTRIBUTES:
            raise InputError(f"G-PCC stream: more than {MAX_ATTRIBUTES} attributes")
        for attribute in sps.attributes:
            _check(attribute)
        self._count += count * sum(each.attr_components_minus1 + 1 for each in sps.attributes)
        if self._count > MAX_VALUES:
            raise InputError(f"G-PCC stream: more than {MAX_VALUES} values of attributes")

    def take(self, payload_type: int, payload: bytes) -> None:
        if payload_type == syntax.ATTRIBUTE_PARAMETER_SET:
            self._parameter_set(payload)
        elif payload_type == syntax.ATTRIBUTE_DATA_UNIT:
            self._data_unit(payload)
        elif payload_type == syntax.CONSTANT_ATTRIBUTE_DATA_UNIT:
            self._constant(payload)

    def _parameter_set(self, payload: bytes) -> None:
        aps = AttributeParameterSet()
        attribute_syntax.attribute_parameter_set(BitReader(payload), aps)
        self._aps.setdefault(aps.aps_attr_parameter_set_id, aps)

    def start_slice(
        self, sps: SequenceParameterSet, header: GeometryHeader, points: SlicePoints
    ) -> None:
        if self._sps is None:
            self._values = [[] for _ in sps.attributes]
        if self._sps is None or not header.entropy_continuation_flag:
            self._contexts = [initial_probabilities() for _ in sps.attributes]
        self._sps, self._slice, self._slice_id = sps, points, header.slice_id
        self._pending = set(range(len(sps.attributes)))
        count = len(points.positions)
        for attribute, values in zip(sps.attributes, self._values, strict=True):
            bits, components = _shape(attribute)
            default = attribute.attr_default_value or (1 << bits - 1,) * components
            values.append(np.broadcast_to(np.array(default, np.int32), (count, components)))

    def _data_unit(self, payload: bytes) -> None:
        if self._slice is None or self._sps is None:
            raise InputError("G-PCC stream: values of an attribute precede the geometry")
        aps = self._aps.get(payload[0] >> 4) if payload else None
        if aps is None:
            raise InputError("G-PCC stream: values of an attribute without a parameter set")
        reader, header = BitReader(payload), AttributeHeader()
        attribute_syntax.attribute_header(reader, header, aps, self._sps.attributes)
        attribute = self._described(header)
        bits, components = _shape(attribute)
        data = np.frombuffer(payload, dtype=np.uint8, offset=reader.position)
        count = len(self._slice.positions)
        if aps.attr_encoding == RAW:
            values = _raw_values(data, aps, count, bits, components)
        else:
            coded, bypass = (
                demultiplexed(data) if self._sps.bypass_stream_enabled_flag else (data, None)
            )
            contexts = self._contexts[header.attr_sps_attr_idx]
            coefficients = decode_coefficients(coded, bypass, contexts, count, components)
            values = decoded_attribute(coefficients, self._slice, aps, header, attribute)
        self._values[header.attr_sps_attr_idx][-1] = values

    def _constant(self, payload: bytes) -> None:
        if self._slice is None or self._sps is None:
            raise InputError("G-PCC stream: values of an attribute precede the geometry")
        reader, header = BitReader(payload), AttributeHeader()
        reader.bits(4)
        reader.exp_golomb(0)
        header.attr_sps_attr_idx = reader.exp_golomb(0)
        header.attr_geom_slice_id = reader.exp_golomb(0)
        bits, components = _shape(self._described(header))
        values = np.array([reader.bits(bits) for _ in range(components)], dtype=np.int32)
        shape = (len(self._slice.positions), components)
        self._values[header.attr_sps_attr_idx][-1] = np.broadcast_to(values, shape)

    def _described(self, header: AttributeHeader) -> AttributeDescription:
        if header.attr_geom_slice_id != self._slice_id:
            raise InputError("G-PCC stream: values of an attribute of another slice")
        if self._sps is None or header.attr_sps_attr_idx not in self._pending:
            raise InputError("G-PCC stream: values of an attribute are repeated or not described")
        self._pending.remove(header.attr_sps_attr_idx)
        return self._sps.attributes[header.attr_sps_attr_idx]

    def attributes(self, converted: bool) -> dict[str, Attribute]:
        """Return all decoded values by name, each (n,) or (n, 3).

        If `converted`, colours are red, green and blue; otherwise they are in the coded colour
        space.
        """
        result: dict[str, Attribute] = {}
        readers = [reader for reader in (self, *self._branches) if reader._values]
        described = next((reader._sps.attributes for reader in readers if reader._sps), [])
        for index, attribute in enumerate(described):
            parts = [values for reader in readers for values in reader._values[index]]
            values = parts[0] if len(parts) == 1 else np.concatenate(parts)
            bits, components = _shape(attribute)
            if attribute.scaling and attribute.attr_label == REFLECTANCE:
                values, bits = decoded_values(values, attribute.scaling), _MOST_BITDEPTH
            if converted and attribute.attr_label == COLOUR and components == 3:
                matrix = attribute.matrix_coefficients
                values = decoded_colours(values, matrix, bits)
                bits -= matrix == YCGCO
            values = values if components > 1 else values[:, 0]
            name = attribute_name(attribute, index)
            name = name if name not in result else f"{name}_{index}"
            result[name] = values.astype(np.uint8) if bits <= 8 else values.astype(np.uint16)
        return result


def attribute_name(attribute: AttributeDescription, index: int) -> str:
    label = attribute.attr_label
    has_name = label is not None and label < len(_LABELS)
    return _LABELS[label or 0] if has_name else f"attribute_{index}"


def _shape(attribute: AttributeDescription) -> tuple[int, int]:
    return attribute.attr_bitdepth_minus1 + 1, attribute.attr_components_minus1 + 1


def _check(attribute: AttributeDescription) -> None:
    bits, components = _shape(attribute)
    if bits > _MOST_BITDEPTH or components not in (1, 3):
        raise InputError(
            f"G-PCC stream: an attribute of {components} components of {bits} bits is not supported"
        )
    scale_minus1, frac_bits, offset = attribute.scaling or (0, 0, 0)
    if max(scale_minus1, abs(offset)) >= _MOST_SCALING or frac_bits > _MOST_FRAC_BITS:
        raise InputError("G-PCC stream: the scale or offset of an attribute is not supported")


def decoded_attribute(
    coefficients: NDArray[np.int32],
    points: SlicePoints,
    aps: AttributeParameterSet,
    header: AttributeHeader,
    attribute: AttributeDescription,
) -> Values:
    bits, _ = _shape(attribute)
    most = (1 << bits) - 1
    parameters = qps(aps, header, bits, points.coordinates(aps), points.axes)
    if not aps.has_levels:
        codes, _, indices = points.in_morton_order(aps)
        values = np.empty_like(coefficients)
        values[indices] = raht.inverse(
            codes, coefficients, parameters.ordered(indices), raht.prediction_thresholds(aps)
        )
        return np.clip(values, 0, most)
    steps = quantisers(parameters)
    levels = points.levels(aps, header)
    coded = np.empty_like(coefficients)
    if aps.attr_encoding == LIFTING:
        weights = lifting.lifting_weights(levels, bool(aps.scalable_lifting_enabled_flag))
        transformed = np.empty(coefficients.shape, dtype=np.int64)
        factors = np.zeros(len(levels.ends) + 1, dtype=np.int64)
        coded_factors = header.last_component_coeffs[: len(levels.ends)]
        factors[: len(coded_factors)] = coded_factors
        lifting.dequantise(
            coefficients, steps, levels.order, levels.ends, weights, factors, transformed
        )
        lifting.transform(levels, weights, transformed, 1)
        coded = np.clip(transformed + _HALF >> FRACTION_BITS, 0, most).astype(np.int32)
    else:
        tools, weights = prediction_tools(levels, aps, header, bits)
        coding = (coded, coefficients, levels.predictors, tools, steps, levels.order, weights)
        prediction.code_values(prediction.Coding(*coding, np.empty((0, 2), dtype=np.int64)))
    values = np.empty_like(coded)
    values[levels.order] = coded
    return values


def prediction_tools(
    levels: Levels, aps: AttributeParameterSet, header: AttributeHeader, bits: int
) -> tuple[prediction.PredictionTools, NDArray[np.int64]]:
    """Return the tools of the predicting transform, and the weights (n,) of points' residuals."""
    shares = np.array([aps.quant_neigh_weight], dtype=np.int64)
    factors = np.array(header.inter_component_coeffs, dtype=np.int64).reshape(-1, 2)
    tools = prediction.PredictionTools(
        levels.ends,
        (1 << bits) - 1,
        min(aps.max_num_direct_predictors, 4),
        aps.direct_avg_predictor_disabled_flag,
        aps.adaptive_prediction_threshold << max(0, bits - 8),
        factors,
    )
    return tools, point_weights(levels.predictors, shares)


def _raw_values(
    data: NDArray[np.uint8], aps: AttributeParameterSet, count: int, bits: int, components: int
) -> Values:
    if aps.raw_attr_variable_len_flag:
        raise InputError("G-PCC stream: values of variable length are not supported")
    needed = count * components * bits
    if len(data) * 8 < needed:
        raise InputError("G-PCC stream: the values of an attribute are truncated")
    values = np.empty(count * components, dtype=np.int32)
    weights = 1 << np.arange(bits)[::-1]
    for start in range(0, len(values), _RAW_BLOCK):  # of whole bytes
        block = values[start : start + _RAW_BLOCK]
        part = data[start * bits // 8 : -(-(start + len(block)) * bits // 8)]
        digits = np.unpackbits(part)[: len(block) * bits].reshape(-1, bits)
        np.matmul(digits, weights, out=block, casting="same_kind")
    return values.reshape(count, components)
