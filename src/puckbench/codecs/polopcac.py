"""The codec PoLoPCAC as published, for reflectances and colours, after G-PCC's octree.

Positions are coded as `gpcc` codes them with the option ``duplicates: kept``. A stream is a frame
(`pointkit.coding.framing`) of the length of the positions in bytes, the positions (`gpcc.grid`),
and the attributes (`pcc_networks.polopcac.stream`), if there are any.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from gpcc.grid import input_coordinates, input_grid, quantise, unwrap, wrap
from gpcc.options import PROFILES
from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.framing import Framing
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import CloudKind
from puckbench.codecs.gpcc import (
    EIGHTHS,
    MOST_STEPS,
    NO_ATTRIBUTES,
    UnitOptions,
    finest_step,
    scale_of,
)
from puckbench.codecs.learned import Learned, LearnedOptions
from puckbench.codecs.rates import Parameters, grid_fault, lengths, parameters_of
from puckbench.codecs.registry import CODECS
from puckbench.geometry.attributes import (
    COLOUR,
    REFLECTANCE,
    Attributes,
    cloud_with,
    coded_attributes,
)

if TYPE_CHECKING:
    from pcc_networks.polopcac.weights import PolopcacWeights

CODE = (
    "gpcc.*",
    "pcc_networks",
    "pcc_networks.polopcac",
    "pcc_networks.sparse",
    "puckbench.codecs.gpcc",
    "puckbench.codecs.learned",
)

PUBLISHED_WEIGHTS = "data/polopcac_weights"
"""Folder to which `puckbench data polopcac_weights` writes the weights of PoLoPCAC's authors."""
_MAGIC = b"PLPC"
_FRAMING = Framing(_MAGIC, 1, "PoLoPCAC")
_TOOLS = PROFILES["ctc"].model_copy(update={"merge_duplicates": False})


class PolopcacOptions(LearnedOptions, UnitOptions):
    weights: str = Field(
        PUBLISHED_WEIGHTS, description="a folder with the authors' weights, or their file"
    )


@CODECS.register("polopcac")
class Polopcac(Learned["PolopcacWeights"]):
    """The codec is the learned PoLoPCAC as published (You, Gao, Ma 2024), after G-PCC's octree.

    It codes reflectances and colours without loss, at every rate, with the weights of its authors.
    Rates are grids of positions. All points are kept, also those that become equal.
    """

    rates: Mapping[str, Parameters] = {**EIGHTHS, **lengths()}
    any_scale = True
    Options: type[PolopcacOptions] = PolopcacOptions
    options: PolopcacOptions
    magic = _MAGIC
    attributes = (REFLECTANCE, COLOUR)
    version = "PoLoPCAC, stream version 1"
    network = "polopcac"
    published_weights = PUBLISHED_WEIGHTS

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.grid = finest_step(self)

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        most_m = MOST_STEPS * parameters_of(self, rate).get("step_m", math.inf)
        return (
            grid_fault(self, cloud.frame, rate)
            or cloud.wider_than(most_m)
            or super().skip(cloud, rate)
        )

    def load(self) -> None:
        x, y = np.divmod(np.arange(20), 5)
        points = np.column_stack([x, y, x * y]) * self.options.step
        colours = np.tile(10 * x, (3, 1)).T.astype(np.uint8)
        held: Attributes = {REFLECTANCE: np.arange(20), COLOUR: colours}
        self.decode(self._encoded(points, {}, held))

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        held = coded_attributes(cloud, self.attributes)
        return self._encoded(cloud.xyz, parameters_of(self, rate), held)

    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        return self._encoded(points, parameters, NO_ATTRIBUTES)

    def _encoded(self, points: Floats, parameters: Parameters, held: Attributes) -> bytes:
        from gpcc.coder import encode_geometry
        from pcc_networks.polopcac.codec import encode

        scale = scale_of(parameters)
        grid = input_grid(points, float(parameters.get("step_m", self.options.step)), scale)
        positions, origin = quantise(points, grid, scale)
        geometry = wrap(encode_geometry(positions, _TOOLS, scale, origin), grid)
        values = encode(positions, held, self.weights_of(parameters)) if held else b""
        return _FRAMING.framed(base_128(len(geometry)) + geometry + values)

    def decode(self, stream: bytes) -> PointCloud:
        from gpcc.coder import decode_geometry
        from pcc_networks.polopcac.codec import decode
        from pcc_networks.polopcac.stream import read_stream

        geometry, values = _parts(stream)
        bare, grid = unwrap(geometry)
        decoded = decode_geometry(bare)
        held: Attributes = NO_ATTRIBUTES
        if values:
            weights = self.weights_with(read_stream(values).digest)
            held = decode(values, decoded.points, weights)
        return cloud_with(input_coordinates(decoded.positions(), grid), held)

    def attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        from pcc_networks.polopcac.stream import attribute_bytes

        values = _parts(stream)[1]
        return attribute_bytes(values) if values else {}

    def read_weights(self, path: Path) -> PolopcacWeights:
        from pcc_networks.polopcac.weights import load_weights

        return load_weights(path)


def _parts(stream: bytes) -> tuple[bytes, bytes]:
    """Return the coded positions and the coded attributes of a stream."""
    reader = Reader(_FRAMING.unframed(stream)[1])
    return reader.take(reader.number()), reader.rest()
