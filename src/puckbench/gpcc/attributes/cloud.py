"""Encoder and decoder of clouds with attributes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from puckbench.gpcc.attributes.reader import AttributeReader
from puckbench.gpcc.coder import DecodedGeometry, read_stream

Attribute = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class DecodedCloud(DecodedGeometry):
    """Decoded points of a stream, and their attributes by name, (m,) or (m, 3)."""

    attributes: dict[str, Attribute] = field(default_factory=dict)


def decode_cloud(stream: bytes, convert_colours: bool = True) -> DecodedCloud:
    """Decode points and attributes of a stream of one frame.

    Parameters
    ----------
    convert_colours
        Whether to convert colours to red, green, blue; otherwise return the coded components.

    Raises
    ------
    InputError
        If the stream is damaged or a tool is unsupported.
    """
    reader = AttributeReader()
    geometry = read_stream(stream, reader)
    return DecodedCloud(**vars(geometry), attributes=reader.attributes(convert_colours))
