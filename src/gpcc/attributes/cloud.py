from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc import syntax
from gpcc.attributes import syntax as attribute_syntax
from gpcc.attributes.colours import Values
from gpcc.attributes.options import AttributeOptions
from gpcc.attributes.reader import Attribute, AttributeReader, attribute_name
from gpcc.attributes.recolouring import Source, recoloured
from gpcc.attributes.writer import AttributeEncoder
from gpcc.bits import BitReader
from gpcc.coder import CodedPoints, DecodedGeometry, decode_geometry, encode_geometry
from gpcc.options import PROFILES, GpccOptions
from gpcc.predictive_coder import PredictiveOptions, encode_predictive_geometry
from gpcc.sensor import SensorDescription
from gpcc.syntax import Three
from pointkit.errors import InputError
from pointkit.geometry.morton import morton_codes


@dataclass(frozen=True)
class DecodedCloud(DecodedGeometry):
    """Decoded points of a stream, and their attributes by name, (m,) or (m, 3)."""

    attributes: dict[str, Attribute] = field(default_factory=dict)


def decode_cloud(stream: bytes, convert_colours: bool = True) -> DecodedCloud:
    """Decode points and attributes of a stream of one frame.

    convert_colours: whether to convert colours to red, green, blue.
    """
    reader = AttributeReader()
    geometry = decode_geometry(stream, reader)
    return DecodedCloud(**vars(geometry), attributes=reader.attributes(convert_colours))


def attribute_bytes(stream: bytes) -> dict[str, int]:
    """Return, by name, the number of bytes of each attribute and its parameter set."""
    names: list[str] = []
    sizes: dict[str, int] = {}
    sets: dict[int, int] = {}
    for kind, payload in syntax.payloads(stream):
        size = syntax.PREFIX_BYTES + len(payload)
        if kind == syntax.SEQUENCE_PARAMETER_SET and not names:
            sps = syntax.SequenceParameterSet()
            syntax.sequence_parameter_set(BitReader(payload), sps)
            names = [attribute_name(each, index) for index, each in enumerate(sps.attributes)]
        elif kind == syntax.ATTRIBUTE_PARAMETER_SET and payload:
            sets[payload[0] >> 4] = size
        elif kind in (syntax.ATTRIBUTE_DATA_UNIT, syntax.CONSTANT_ATTRIBUTE_DATA_UNIT):
            header = attribute_syntax.AttributeHeader()
            attribute_syntax.attribute_ids(BitReader(payload), header)
            if header.attr_sps_attr_idx >= len(names):
                raise InputError("G-PCC stream: values of an unknown attribute")
            name = names[header.attr_sps_attr_idx]
            shared = sets.pop(header.attr_attr_parameter_set_id, 0)
            sizes[name] = sizes.get(name, 0) + size + shared
    return sizes


def encode_cloud(
    points: NDArray[Any],
    attributes: Mapping[str, NDArray[Any]],
    options: GpccOptions | PredictiveOptions = PROFILES["ctc"],
    attribute_options: Mapping[str, AttributeOptions] | None = None,
    scale: Fraction | float = 1,
    origin: Sequence[int] | NDArray[np.int64] = (0, 0, 0),
    sensor: SensorDescription | None = None,
    source: NDArray[Any] | None = None,
) -> bytes:
    """Encode integer points (n, 3) with attributes as a stream that TMC13 decodes.

    Parameters
    ----------
    attributes
        Values by name: red, green, blue as `color` (n, 3), and `reflectance` (n,); possibly none.
    options
        Options of the octree, or of prediction trees.
    attribute_options
        Options by attribute name; by default `AttributeOptions()`.
    scale, origin, sensor
        See `coder.encode_geometry`.
    source
        Exact positions (n, 3), in the coordinates of decoded positions, from which merged points
        are recoloured; by default `points`.

    Raises
    ------
    InputError
        If the points or their attributes cannot be encoded.
    """
    options_by_name = attribute_options or {}
    chosen = {name: options_by_name.get(name, AttributeOptions()) for name in attributes}
    if unused := options_by_name.keys() - chosen.keys():
        raise InputError(f"G-PCC: options of '{min(unused)}', which is not among the attributes")
    whole = np.asarray(points)
    exact = whole if source is None else np.asarray(source)
    factor = 1.0 if source is None else float(np.float32(float(scale)))
    offset = np.zeros(3) if source is None else np.asarray(origin)

    def recolour(values: Values, coded: CodedPoints, corner: Three, bits: int) -> Values:
        placed = coded.points.positions[:, coded.points.axes]
        shift = offset + whole.min(axis=0) + np.array(corner)
        members = _grouped(coded.members, whole)
        source_points = Source(exact[members].astype(np.float64), factor, shift)
        return recoloured(placed, values[members], source_points, (1 << bits) - 1)

    encoder = AttributeEncoder(attributes, chosen, len(whole), recolour) if attributes else None
    if isinstance(options, PredictiveOptions):
        return encode_predictive_geometry(whole, options, scale, origin, sensor, encoder)
    return encode_geometry(whole, options, scale, origin, sensor, encoder)


def _grouped(members: NDArray[np.int64], points: NDArray[Any]) -> NDArray[np.int64]:
    """Sort indices of points so that equal points are adjacent, in TMC13's order."""
    part = points[members].astype(np.int64)
    codes = morton_codes(part - part.min(axis=0), np.arange(3))
    _, first, unique = np.unique(codes, return_index=True, return_inverse=True)
    grouped: NDArray[np.int64] = members[np.argsort(first[unique], kind="stable")]
    return grouped
