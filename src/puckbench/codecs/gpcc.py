"""G-PCC's octree geometry, and base classes of codecs that encode points on a grid like G-PCC."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from puckbench import __version__
from puckbench.codecs.base import Codec, Pace, Parameters, Takes, lengths
from puckbench.codecs.registry import CODECS
from puckbench.core.errors import InputError, naming
from puckbench.core.models import Model
from puckbench.geometry.cloud import Floats, check_points
from puckbench.gpcc.container import unwrap, wrap
from puckbench.gpcc.grid import (
    DEFAULT_GRID,
    MOST_BITS,
    InputGrid,
    Rounding,
    input_coordinates,
    input_grid,
    quantise,
)
from puckbench.gpcc.options import PROFILES, GpccOptions

if TYPE_CHECKING:
    from puckbench.geometry.morton import Ints
    from puckbench.gpcc.sensor import SensorDescription
    from puckbench.lidar.returns import Returns

EIGHTHS: Mapping[str, Parameters] = {
    f"r{eighths}": {"scale": eighths / 8} for eighths in range(1, 9)
}
"""Rates of PCC Arena, which the thesis used: factors by which coordinates are multiplied."""


LOSSLESS_STEP_M = 0.002
"""Largest grid step (m) at which coding of a sensor's points counts as lossless."""


class UnitOptions(Model):
    """The option `unit`: the step of the input's grid, which a rate with scale 1 preserves."""

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
    """Options for quantisation and for the coding tools of G-PCC."""

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


class GridCodec(Codec):
    """Base class of the codecs that use puckbench's G-PCC coder or the reference software.

    A rate is the factor `scale` by which coordinates are multiplied before they are rounded or, for
    clouds in metres, the grid step to which they are rounded. A stream's wrapper holds the grid's
    unit and offset.
    """

    rates: Mapping[str, Parameters] = EIGHTHS
    metric_rates: Mapping[str, Parameters] = lengths()
    Options: type[GridOptions] = GridOptions
    options: GridOptions
    magic = b"PBGP"
    pace = Pace(0.05, 1.5)
    bare_magic = b"\0\0\0"
    most_steps = float(2**MOST_BITS - 2)

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        finest = max((rate["scale"] for rate in self.rates.values()), default=1.0)
        self.grid = self.options.step / finest
        self.shifts_far_clouds = not self.options.raw

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        return self._encoded(points, parameters)

    def _encoded(
        self, points: Floats, parameters: Parameters, returns: Returns | None = None
    ) -> bytes:
        step = float(parameters.get("step_m", self.options.step))
        grid = input_grid(points, step, scale_of(parameters))
        if self.options.raw and grid != DEFAULT_GRID:
            raise InputError(f"codec {self.name}: a bare stream cannot hold the unit or the offset")
        with naming(f"codec {self.name}"):
            stream = self._code(points, grid, parameters, returns)
        return stream if self.options.raw else wrap(stream, grid)

    def _decode(self, stream: bytes) -> Floats:
        with naming(f"codec {self.name}"):
            bare, grid = unwrap(stream)
            return input_coordinates(self._units(bare), grid)

    def _merges(self, parameters: Parameters) -> bool:
        if self.options.duplicates != "by_rate":
            return self.options.duplicates == "merged"
        return self._loses(parameters)

    def _loses(self, parameters: Parameters) -> bool:
        """Whether a rate is lossy: it has a scale below 1, or a grid step of more than 2 mm."""
        if "step_m" in parameters:
            return float(parameters["step_m"]) > LOSSLESS_STEP_M
        return scale_of(parameters) < 1

    @abstractmethod
    def _code(
        self, points: Floats, grid: InputGrid, parameters: Parameters, returns: Returns | None
    ) -> bytes:
        """Encode points (n, 3), and their returns if there are any, to a stream without wrapper."""

    @abstractmethod
    def _units(self, stream: bytes) -> Floats:
        """Decode the points (m, 3) of a stream without wrapper, in units of the input's grid."""


class OnGrid(NamedTuple):
    """Points on a grid as integers: a point is at (`positions` + `origin`) / `scale`.

    `sensor` describes the sensor of the points, if there is one.
    """

    positions: Ints
    origin: Ints
    scale: float = 1.0
    sensor: SensorDescription | None = None


class OwnCodec(GridCodec):
    """Base class of the codecs that use puckbench's G-PCC coder."""

    version = f"puckbench {__version__}"

    def load(self) -> None:
        from puckbench.gpcc.sensor import SensorDescription

        points = np.array([[0, 0, 0], [5, 3, 1], [5, 3, 1], [50, 30, 10]])
        sensors = (None, SensorDescription((0.0,), (0.0,), 100))
        for sensor in sensors[: 1 if self.takes == "points" else 2]:
            self._units(self._stream(OnGrid(points, np.zeros(3, np.int64), sensor=sensor), {}))

    def _code(
        self, points: Floats, grid: InputGrid, parameters: Parameters, returns: Returns | None
    ) -> bytes:
        from puckbench.gpcc.sensor import describe_sensor

        scale = scale_of(parameters)
        positions, origin = quantise(points, grid, scale, self.options.rounding)
        sensor = None
        if returns is not None:
            x, y, z = (round(-offset / grid.unit) for offset in grid.offset)
            sensor = describe_sensor(returns.beams, grid.unit, returns.columns_per_turn, (x, y, z))
        return self._stream(OnGrid(positions, origin, scale, sensor), parameters)

    def _units(self, stream: bytes) -> Floats:
        from puckbench.gpcc.coder import decode_geometry

        return decode_geometry(stream).positions()

    @abstractmethod
    def _stream(self, points: OnGrid, parameters: Parameters) -> bytes:
        """Encode points on the grid to a stream of the standard, without wrapper."""


class SensorCodec(OwnCodec):
    """Base class of codecs that use the sensor's lasers to encode clouds with returns."""

    takes: ClassVar[Takes] = "either"

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        parameters, points = self.parameters_of(rate), returns.points()
        check_points(points, f"codec {self.name}")
        return self._encoded(points, parameters, returns)


def scale_of(parameters: Parameters) -> float:
    """Return the factor by which a rate multiplies coordinates, by default 1."""
    return float(parameters.get("scale", 1.0))


@CODECS.register("gpcc")
class Gpcc(OwnCodec):
    """G-PCC's octree geometry by puckbench's coder, with the tools of MPEG's test conditions."""

    title = "G-PCC"
    use = "the anchor; lossless coding on a grid"
    colour = "#E69F00"
    marker = "s"
    rank = 10

    def _stream(self, points: OnGrid, parameters: Parameters) -> bytes:
        from puckbench.gpcc.coder import encode_geometry

        tools = self._tools(parameters)
        return encode_geometry(points.positions, tools, points.scale, points.origin)

    def _tools(self, parameters: Parameters) -> GpccOptions:
        tools: dict[str, Any] = {"merge_duplicates": self._merges(parameters)}
        if self.options.profile == "spinning" and self._loses(parameters):
            tools["inferred_direct_coding_mode"] = 1
        return PROFILES[self.options.profile].model_copy(update=tools)
