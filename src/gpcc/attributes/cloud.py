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
    """The points of a decoded stream, and their attributes.

    Attributes
    ----------
    attributes
        Values by name, as ``uint8`` or, for more than 8 bits, ``uint16``: ``color`` (m, 3) and
        ``reflectance`` (m,). Other attributes of the standard have their names in TMC13. Row i
        belongs to row i of `points`. The other fields are those of `DecodedGeometry`.
    """

    attributes: dict[str, Attribute] = field(default_factory=dict)


def decode_cloud(stream: bytes, convert_colours: bool = True) -> DecodedCloud:
    """Decode the points and the attributes of a G-PCC stream that holds one frame.

    Parameters
    ----------
    stream
        A bare stream, as `encode_cloud` and TMC13 write it.
    convert_colours
        Whether to convert colours from the coded colour space to red, green and blue.

    Returns
    -------
    DecodedCloud
        Integer points with their scale and origin, and the attributes by name.

    Raises
    ------
    InputError
        The stream is damaged, or uses a tool that this decoder does not support.
    """
    reader = AttributeReader()
    geometry = decode_geometry(stream, reader)
    return DecodedCloud(**vars(geometry), attributes=reader.attributes(convert_colours))


def attribute_bytes(stream: bytes) -> dict[str, int]:
    """Return the number of bytes of each attribute in a stream, by the attribute's name.

    They include the attribute's parameter set, and the prefixes of the attribute's data units.
    """
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
    """Encode points and their attributes as a G-PCC stream of one frame, which TMC13 can decode.

    Parameters
    ----------
    points
        Integer coordinates (n, 3) in steps of the grid, as `quantise` returns them.
    attributes
        Integer values by name: ``color`` (n, 3) with red, green and blue, ``reflectance`` (n,),
        both, or none. Row i belongs to row i of `points`.
    options
        Coding tools of the positions: `GpccOptions` selects an octree, `PredictiveOptions` selects
        prediction trees.
    attribute_options
        Coding tools of each attribute by name. By default, these are ``AttributeOptions()``, which
        code reflectances without loss.
    scale, origin, sensor
        As in `encode_geometry`.
    source
        Positions (n, 3) before they were rounded to the grid, in the coordinates of decoded
        positions. They are used where several points are merged: the attributes of the merged point
        are interpolated between those of near positions in `source`. By default, `points` are used.

    Returns
    -------
    bytes
        The stream, for `decode_cloud`.

    Raises
    ------
    InputError
        The points cannot be encoded (see `encode_geometry`), or an attribute has another name,
        another shape, or values of more bits than its options say.
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
