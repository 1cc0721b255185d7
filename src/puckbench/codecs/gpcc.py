"""The codec `gpcc`, G-PCC's octree geometry, and base classes of codecs that encode a grid."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from gpcc.attributes.options import mpeg_conditions, qp_of_scale, qp_of_step
from gpcc.grid import (
    DEFAULT_GRID,
    MOST_BITS,
    InputGrid,
    Rounding,
    input_coordinates,
    input_grid,
    quantise,
    unwrap,
    wrap,
)
from gpcc.options import PROFILES, GpccOptions
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.turns import Layout, Turn
from pointkit.models import Model
from puckbench import __version__
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.rates import Parameters, grid_fault, lengths, parameters_of, scaled_rates
from puckbench.codecs.registry import CODECS
from puckbench.geometry.attributes import (
    COLOUR,
    REFLECTANCE,
    RETURNS,
    Attributes,
    cloud_with,
    coded_attributes,
)

if TYPE_CHECKING:
    from gpcc.predictive_coder import PredictiveOptions

CODE = ("gpcc.*", "pointkit.lidar.sensors")

EIGHTHS: Mapping[str, Parameters] = {
    f"r{eighths}": {"scale": eighths / 8} for eighths in range(1, 9)
}
"""Rates of PCC Arena, which the thesis used. Each is a factor by which coordinates are
multiplied."""
NO_ATTRIBUTES: Attributes = MappingProxyType({})
_NAMES = {"color": COLOUR, "reflectance": REFLECTANCE}
_LABELS = {name: label for label, name in _NAMES.items()}
MOST_STEPS = float(2**MOST_BITS - 2)
"""Largest extent along an axis, in steps of the grid."""
LOSSLESS_STEP_M = 0.002
"""Largest grid step (m) at which coding of a sensor's points counts as lossless."""


class UnitOptions(Model):
    """The option `unit` is the step of the input's grid, which a rate with scale 1 preserves."""

    unit: float | None = Field(
        None,
        gt=0,
        description="step of the input's grid, which scale 1 keeps; by default 1, that of scaled "
        "clouds",
    )

    @property
    def step(self) -> float:
        return self.unit or 1.0


class GridOptions(UnitOptions):
    profile: Literal["minimal", "ctc", "spinning", "defaults"] = Field(
        "ctc",
        description="coding tools: the octree alone; those of the common test conditions, or of "
        "these for spinning sensors (without a sensor); TMC13's defaults",
    )
    rounding: Rounding = Field(
        "nearest", description="of coordinates; `truncate` as TMC13 reads floating-point files"
    )
    duplicates: Literal["merged", "kept", "by_rate"] = Field(
        "merged",
        description="points of one grid position: one, or all of them; `by_rate`: all at scale 1 "
        "and on grids of 2 mm or finer, else one",
    )
    raw: bool = Field(False, description="write bare streams, as the reference software does")


class CoderOptions(GridOptions):
    attributes: bool = Field(
        False,
        description="also code reflectances and colours: without loss where positions are, else at "
        "MPEG's QPs, or with the parameter `qp` of a rate",
    )
    transform: Literal["raht", "lifting"] = Field(
        "raht", description="transform of attributes that are coded with loss"
    )


class GridCodec(Codec):
    """Base class of codecs that encode points on an integer grid in the format of G-PCC.

    The parameter `scale` of a rate multiplies coordinates before they are rounded. For clouds in
    metres, the parameter is the grid step `step_m`. A wrapper around the stream contains the unit
    and the offset of the grid, unless the option `raw` is set.
    """

    rates: Mapping[str, Parameters] = {**EIGHTHS, **lengths()}
    any_scale = True
    Options: type[GridOptions] = GridOptions
    options: GridOptions
    magic = b"PBGP"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.grid = finest_step(self)

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        most_m = MOST_STEPS * parameters_of(self, rate).get("step_m", math.inf)
        return (
            super().skip(cloud, rate)
            or grid_fault(self, cloud.frame, rate)
            or cloud.wider_than(most_m)
        )

    def encode(self, cloud: PointCloud, rate: str, work: Any = None) -> bytes:
        return self._encoded(cloud.xyz, parameters_of(self, rate))

    def _encoded(
        self,
        points: Floats,
        parameters: Parameters,
        returns: Returns | None = None,
        attributes: Attributes = NO_ATTRIBUTES,
    ) -> bytes:
        step = float(parameters.get("step_m", self.options.step))
        grid = input_grid(points, step, scale_of(parameters))
        if self.options.raw and grid != DEFAULT_GRID:
            raise InputError("a bare stream cannot hold the unit or the offset")
        stream = self._code(points, grid, parameters, returns, attributes)
        return stream if self.options.raw else wrap(stream, grid)

    def _merges(self, parameters: Parameters) -> bool:
        if self.options.duplicates != "by_rate":
            return self.options.duplicates == "merged"
        return self._loses(parameters)

    def _loses(self, parameters: Parameters) -> bool:
        """Return whether a rate is lossy: its scale is below 1, or its grid step above 2 mm."""
        if "step_m" in parameters:
            return float(parameters["step_m"]) > LOSSLESS_STEP_M
        return scale_of(parameters) < 1

    @abstractmethod
    def _code(
        self,
        points: Floats,
        grid: InputGrid,
        parameters: Parameters,
        returns: Returns | None,
        attributes: Attributes,
    ) -> bytes:
        """Encode points (n, 3), returns and attributes to a stream without wrapper."""


class OwnCodec(GridCodec):
    """Base class of codecs that encode with puckbench's own G-PCC coder."""

    version = f"puckbench {__version__}"
    Options = CoderOptions
    options: CoderOptions

    @property
    def attributes(self) -> tuple[str, ...]:
        return (REFLECTANCE, COLOUR) if self.options.attributes else ()

    def attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        from gpcc.attributes.cloud import attribute_bytes

        sizes = attribute_bytes(unwrap(stream).stream)
        return {_NAMES.get(name, name): size for name, size in sizes.items()}

    def load(self) -> None:
        points = np.array([[0, 0, 0], [5, 3, 1], [5, 3, 1], [50, 30, 10]]) * self.options.step
        held: Attributes = {REFLECTANCE: np.arange(4), COLOUR: np.eye(4, 3, dtype=np.uint8)}
        lasers = Beams((0.0,), (0.0,), (0.0,))
        turn = Turn(np.full((1, 4, 1), 500, np.uint16), np.arange(4, dtype=np.uint16) * 20)
        returns = (None, Returns(lasers, Layout((0,)), (turn,)))
        for sensor in returns if RETURNS in self.attributes else returns[:1]:
            self.decode(self._encoded(points, {}, sensor))
            for parameters in ({}, {"qp": 34}) if self.options.attributes else ():
                self.decode(self._encoded(points, parameters, sensor, held))

    def encode(self, cloud: PointCloud, rate: str, work: Any = None) -> bytes:
        attributes = coded_attributes(cloud, self.attributes)
        return self._encoded(cloud.xyz, parameters_of(self, rate), attributes=attributes)

    def decode(self, stream: bytes) -> PointCloud:
        from gpcc.attributes.cloud import decode_cloud

        bare, grid = unwrap(stream)
        decoded = decode_cloud(bare)
        values = {_NAMES.get(name, name): part for name, part in decoded.attributes.items()}
        if COLOUR in values and values[COLOUR].dtype != np.uint8:
            wide = values.pop(COLOUR)
            values |= {f"{name}_16": wide[:, c] for c, name in enumerate(("red", "green", "blue"))}
        return cloud_with(input_coordinates(decoded.positions(), grid), values)

    def _code(
        self,
        points: Floats,
        grid: InputGrid,
        parameters: Parameters,
        returns: Returns | None,
        attributes: Attributes,
    ) -> bytes:
        from gpcc.attributes.cloud import encode_cloud
        from gpcc.sensor import describe_sensor

        scale = scale_of(parameters)
        positions, origin = quantise(points, grid, scale, self.options.rounding)
        sensor = None
        if returns is not None:
            x, y, z = (round(-offset / grid.unit) for offset in grid.offset)
            sensor = describe_sensor(returns.beams, grid.unit, returns.columns_per_turn, (x, y, z))
        values = {_LABELS[name]: part for name, part in attributes.items()}
        tools = self._tools(parameters, angular=sensor is not None)
        qp, transform = self._qp(parameters), self.options.transform
        chosen = mpeg_conditions(values, qp, transform, spherical=sensor is not None)
        source = (points - grid.offset) / grid.unit if attributes else None
        return encode_cloud(positions, values, tools, chosen, scale, origin, sensor, source)

    @abstractmethod
    def _tools(
        self, parameters: Parameters, *, angular: bool = False
    ) -> GpccOptions | PredictiveOptions:
        """Return the tools that code the geometry; if `angular`, they use the sensor's lasers."""

    def _qp(self, parameters: Parameters) -> int | None:
        """Return the quantisation parameter of a rate's attributes, or None for lossless coding."""
        if "qp" in parameters:
            return int(parameters["qp"])
        if not self._loses(parameters):
            return None
        if "step_m" in parameters:
            return qp_of_step(float(parameters["step_m"]))
        return qp_of_scale(scale_of(parameters))


class SensorCodec(OwnCodec):
    """Base class of G-PCC codecs that use the sensor's lasers if a cloud has returns.

    Clouds without returns are encoded too, without this knowledge.
    """

    @property
    def attributes(self) -> tuple[str, ...]:
        return (*super().attributes, RETURNS)

    def encode(self, cloud: PointCloud, rate: str, work: Any = None) -> bytes:
        returns = cloud.returns
        if returns is None:
            return super().encode(cloud, rate)
        values = returns.reflectivities() if self.options.attributes else None
        held = NO_ATTRIBUTES if values is None else {REFLECTANCE: values}
        return self._encoded(returns.points(), parameters_of(self, rate), returns, held)


def finest_step(codec: Codec) -> float:
    """Return the grid step of a codec's finest rate for scaled clouds, in units of the input."""
    scales = (parameters["scale"] for parameters in scaled_rates(codec.rates).values())
    step: float = codec.options.step / max(scales, default=1.0)
    return step


def scale_of(parameters: Parameters) -> float:
    """Return the factor by which a rate multiplies coordinates; it is 1 by default."""
    return float(parameters.get("scale", 1.0))


@CODECS.register("gpcc")
class Gpcc(OwnCodec):
    """The codec is G-PCC's octree geometry, with the tools of MPEG's common test conditions.

    It uses puckbench's own coder.
    """

    def _tools(self, parameters: Parameters, *, angular: bool = False) -> GpccOptions:
        tools: dict[str, Any] = {"merge_duplicates": self._merges(parameters)}
        if self.options.profile == "spinning" and self._loses(parameters):
            tools["inferred_direct_coding_mode"] = 1
        return PROFILES[self.options.profile].model_copy(update=tools)
