"""Predictive geometry as a codec: with a sensor's lasers where a cloud says them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from puckbench import __version__
from puckbench.codecs.base import Pace, Parameters, lengths
from puckbench.codecs.gpcc.codec import GridCodec, GridOptions
from puckbench.codecs.gpcc.container import packed
from puckbench.codecs.gpcc.grid import Frame, frame_of, quantised
from puckbench.codecs.registry import CODECS
from puckbench.core.errors import InputError, naming
from puckbench.geometry.cloud import Floats, PointCloud, check_points

if TYPE_CHECKING:
    from puckbench.codecs.gpcc.predictive_coder import PredictiveOptions
    from puckbench.codecs.gpcc.sensor import SensorDescription
    from puckbench.lidar.returns import Returns

_LEAST_QP = 58
_CENTIDEGREES = 36_000


class TreeOptions(GridOptions):
    """How points come to the grid, and how trees are built."""

    duplicates: Literal["merged", "kept"] = "kept"
    order: Literal["given", "morton", "azimuth", "radius"] = Field(
        "azimuth", description="of the points, in which trees are built"
    )


def _coarse(radius_log2: int, azimuth_log2: int) -> dict[str, Parameters]:
    """A rate by the step of the radius, with the azimuth's steps that MPEG's conditions give it."""
    steps = {"radius_inv_scale_log2": radius_log2, "azimuth_scale_log2": azimuth_log2}
    return {f"{1 << radius_log2}mm": {"step_m": 0.001, **steps}}


@CODECS.register("gpcc_predictive")
class GpccPredictive(GridCodec):
    """G-PCC's predictive geometry; of a spinning sensor's returns in spherical coordinates.

    Of clouds in metres, rates from 4 mm on are steps of the radius; without a sensor, of x, y and
    z. Nothing is lost on grids of 2 and 1 mm.
    """

    title = "G-PCC (predictive)"
    use = "turns of spinning sensors by MPEG's standard"
    colour = "#A65628"
    marker = ">"
    rank = 12
    version = f"puckbench {__version__}"
    pace = Pace(0.05, 4.0)
    uses_sensor = True
    metric_rates: Mapping[str, Parameters] = {
        **_coarse(7, 7),
        **_coarse(5, 8),
        **_coarse(4, 9),
        **_coarse(2, 11),
        **lengths(2, 1),
    }
    Options = TreeOptions
    options: TreeOptions

    @property
    def thesis_role(self) -> str:
        """None: the thesis ran octrees alone."""
        return ""

    def load(self) -> None:
        """Compile the coder, or take it from the cache."""
        from puckbench.codecs.gpcc.coder import decode_geometry
        from puckbench.codecs.gpcc.predictive_coder import encode_predictive
        from puckbench.codecs.gpcc.sensor import SensorDescription

        points = np.array([[0, 0, 0], [5, 3, 1], [5, 3, 1], [9, 4, 2]])
        for sensor in (None, SensorDescription((0.0,), (0.0,), 100)):
            decode_geometry(encode_predictive(points, self._tools({}), sensor))

    def encode_cloud(self, cloud: PointCloud, rate: str) -> bytes:
        """Code a cloud at a named rate, in its sensor's coordinates where it has returns."""
        if cloud.returns is None:
            return self.encode(cloud.xyz, rate)
        return self.encode_returns(cloud.returns, rate)

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        """Code a spinning sensor's returns at a named rate; InputError as for `encode`."""
        parameters, points = self.parameters_of(rate), returns.points()
        check_points(points, f"codec {self.name}")
        return self._coded(points, parameters, returns)

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        return self._coded(points, parameters, None)

    def _coded(self, points: Floats, parameters: Parameters, returns: Returns | None) -> bytes:
        from puckbench.codecs.gpcc.predictive_coder import encode_predictive

        scale = float(parameters.get("scale", 1.0))
        frame = frame_of(points, float(parameters.get("step_m", self.options.step)), scale)
        if self.options.raw and frame != Frame():
            raise InputError(f"codec {self.name}: a bare stream cannot hold the unit or the offset")
        with naming(f"codec {self.name}"):
            positions, origin = quantised(points, frame, scale, self.options.rounding)
            sensor = None if returns is None else _sensor(returns, frame)
            tools = self._tools(parameters, angular=sensor is not None)
            stream = encode_predictive(positions, tools, sensor, scale, origin)
        return stream if self.options.raw else packed(stream, frame)

    def _tools(self, parameters: Parameters, *, angular: bool = False) -> PredictiveOptions:
        from puckbench.codecs.gpcc.predictive_coder import PredictiveOptions

        steps: dict[str, Any] = {
            key: value for key, value in parameters.items() if key.endswith("_log2")
        }
        radius_log2 = steps.get("radius_inv_scale_log2", 0)
        if radius_log2 and angular:  # a step that no error of the radius reaches half of
            steps["base_qp"] = max(_LEAST_QP, 8 * radius_log2 + 2)
        elif radius_log2:
            steps["base_qp"] = 8 * radius_log2
        merged = self.options.duplicates == "merged"
        return PredictiveOptions(order=self.options.order, merge_duplicates=merged, **steps)

    def _code(self, points: Floats, frame: Frame, scale: float) -> bytes:
        raise NotImplementedError("see _coded")

    def _units(self, stream: bytes) -> Floats:
        from puckbench.codecs.gpcc.coder import decode_geometry

        return decode_geometry(stream).positions()


def _sensor(returns: Returns, frame: Frame) -> SensorDescription:
    """The sensor of returns, at the origin of their coordinates, in units of a frame."""
    from puckbench.codecs.gpcc.sensor import SensorDescription

    beams = returns.beams
    x, y, z = (round(-offset / frame.unit) for offset in frame.offset)
    return SensorDescription(
        tuple(np.tan(np.radians(beams.elevations_deg)).tolist()),
        tuple(height / 1000 / frame.unit for height in beams.heights_mm),
        _steps_per_turn(returns),
        (x, y, z),
    )


def _steps_per_turn(returns: Returns) -> int:
    """Firing columns of a turn, by how the azimuth rises from block to block."""
    rises = [
        np.mod(np.diff(turn.azimuths.astype(np.int64)), _CENTIDEGREES) for turn in returns.turns
    ]
    every = np.concatenate(rises) if rises else np.zeros(0, np.int64)
    usual = every[every > 0]
    if not len(usual):
        return 1
    rise = float(np.median(usual))
    near = usual[np.abs(usual - rise) <= 0.5 * rise]
    return max(round(_CENTIDEGREES * returns.layout.columns_per_block / float(near.mean())), 1)
