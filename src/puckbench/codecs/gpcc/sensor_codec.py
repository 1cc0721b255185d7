"""What codecs of G-PCC have in common that use the sensor of a cloud's returns."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

import numpy as np

from puckbench.codecs.base import Parameters
from puckbench.codecs.gpcc.codec import GridCodec
from puckbench.codecs.gpcc.container import packed
from puckbench.codecs.gpcc.grid import Frame, frame_of, quantised
from puckbench.core.errors import InputError, naming
from puckbench.geometry.cloud import Floats, PointCloud, check_points

if TYPE_CHECKING:
    from puckbench.codecs.gpcc.sensor import SensorDescription
    from puckbench.geometry.morton import Ints
    from puckbench.lidar.returns import Returns

_CENTIDEGREES = 36_000


class SensorCodec(GridCodec):
    """Codes a cloud with its sensor's lasers where it has returns, else without."""

    uses_sensor = True

    @property
    def thesis_role(self) -> str:
        """None: the thesis ran octrees alone, without a sensor."""
        return ""

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
        scale = float(parameters.get("scale", 1.0))
        frame = frame_of(points, float(parameters.get("step_m", self.options.step)), scale)
        if self.options.raw and frame != Frame():
            raise InputError(f"codec {self.name}: a bare stream cannot hold the unit or the offset")
        with naming(f"codec {self.name}"):
            positions, origin = quantised(points, frame, scale, self.options.rounding)
            sensor = None if returns is None else _sensor(returns, frame)
            stream = self._stream(positions, origin, scale, parameters, sensor)
        return stream if self.options.raw else packed(stream, frame)

    @abstractmethod
    def _stream(
        self,
        positions: Ints,
        origin: Ints,
        scale: float,
        parameters: Parameters,
        sensor: SensorDescription | None,
    ) -> bytes:
        """The bare stream of positions + origin, (n, 3), on the grid of a rate and its sensor."""

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
