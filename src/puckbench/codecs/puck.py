"""The codec `puck`, which encodes a spinning LiDAR's ranges and azimuths with no or little loss.

A stream contains the name of a sensor that puckbench knows, or the angles of all lasers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.turns import Layout, Turn
from pointkit.models import Model
from puck.records import MAGIC
from puckbench import __version__
from puckbench.codecs.rates import lengths
from puckbench.codecs.registry import CODECS
from puckbench.codecs.returns_codec import ReturnsCodec, cloud_of, returns_of
from puckbench.geometry.attributes import REFLECTANCE

CODE = ("puck.*", "pointkit.lidar.sensors", "puckbench.codecs.returns_codec")


class PuckOptions(Model):
    effort: Literal["fast", "normal", "thorough"] = Field(
        "normal", description="number of estimates of each range"
    )
    lmbda: float = Field(
        0.05,
        ge=0,
        description="Lagrangian weight of rate against squared error, in squared steps a nat; "
        "above 0 ranges may be off by more than half a step (lossy rates only)",
    )
    times: bool = Field(False, description="also code the times of packets")
    reflectivities: bool | Literal["returns"] = Field(
        False, description="also code reflectivities; `returns`: not those of firings without one"
    )
    key_every: int = Field(
        50,
        ge=0,
        description="number of turns from one that is coded without the turn before it to the next "
        "(1: every turn is coded alone; 0: only the first)",
    )


@CODECS.register("puck")
class Puck(ReturnsCodec):
    """The codec predicts a spinning LiDAR's ranges in the range image and codes by context mixing.

    A rate is the step to which ranges are rounded. The sensor's own step (2 mm) is lossless. All
    returns are decoded, with range errors of at most one and a half steps.
    """

    rates = lengths(100, 50, 20, 10, 4, 2)
    Options = PuckOptions
    options: PuckOptions
    magic = MAGIC
    version = f"puckbench {__version__}"

    def attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        from puck import reflectivity_bytes

        return {REFLECTANCE: reflectivity_bytes(stream)}

    def load(self) -> None:
        turn = Turn(np.full((1, 8, 2), 500, np.uint16), np.arange(8, dtype=np.uint16) * 20)
        beams = Beams((-1.0, 1.0), (0.0, 0.0), (0.0, 0.0))
        self.decode(self._stream(Returns(beams, Layout((0, 1)), (turn, turn)), 1))

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        returns = returns_of(cloud)
        return self._stream(returns, self.step_in_quanta(returns, rate))

    def _stream(self, returns: Returns, step: int) -> bytes:
        from puck import CodingOptions, encode_returns

        options = self.options
        if options.reflectivities == "returns":
            returns = replace(returns, turns=tuple(map(_without_others, returns.turns)))
        lmbda = options.lmbda * step**2 if step > 1 else 0.0
        coding = CodingOptions(
            step,
            lmbda,
            options.times,
            bool(options.reflectivities),
            options.effort,
            options.key_every,
        )
        return encode_returns(returns, coding)

    def decode(self, stream: bytes) -> PointCloud:
        from puck import decode_returns

        return cloud_of(decode_returns(stream))


def _without_others(turn: Turn) -> Turn:
    if turn.reflectivities is None:
        return turn
    return replace(turn, reflectivities=turn.reflectivities * (turn.ranges > 0))
