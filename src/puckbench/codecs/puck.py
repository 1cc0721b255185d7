"""`puck` as a codec of the benchmark: ranges and azimuths of returns, without loss or with little.

The sensor's beams stand in the stream: by the name of a sensor that puckbench ships, or all angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from typing import Literal

import numpy as np
from pydantic import Field

from puckbench import __version__
from puckbench.codecs.base import Pace, Parameters, lengths
from puckbench.codecs.registry import CODECS
from puckbench.codecs.returns_codec import ReturnsCodec, step_in_quanta
from puckbench.core.errors import InputError
from puckbench.core.models import Model
from puckbench.lidar.returns import Beams, Returns
from puckbench.lidar.turns import Layout, Turn
from puckbench.puck.beams import packed_beams, unpacked_beams
from puckbench.puck.layout import packed, unpacked
from puckbench.puck.records import DAMAGED, MAGIC, Kind, Record, read_records, stream_of


class PuckOptions(Model):
    """What is coded of returns, and with how much effort."""

    effort: Literal["fast", "normal", "thorough"] = Field(
        "normal", description="how many estimates are taken of each range"
    )
    lmbda: float = Field(
        0.05,
        ge=0,
        description="Lagrangian weight of rate against squared error, in squared steps a nat; "
        "above 0 ranges may be off by more than half a step (lossy rates only)",
    )
    times: bool = Field(False, description="code the times of packets too")
    reflectivities: bool = Field(False, description="code reflectivities too")


@CODECS.register("puck")
class Puck(ReturnsCodec):
    """Ranges by laser and firing column, predicted and coded by context mixing.

    A rate is the step of the ranges; the sensor's own (2 mm) is without loss. No return is lost,
    and no range is off by more than a step and a half.
    """

    title = "Puck"
    use = "recordings and scans of spinning sensors, exact or nearly"
    colour = "#7A0177"
    marker = "*"
    rank = 5
    metric_rates = lengths(100, 50, 20, 10, 4, 2)
    Options = PuckOptions
    options: PuckOptions
    magic = MAGIC
    pace = Pace(0.05, 1.2)
    version = f"puckbench {__version__}"

    def load(self) -> None:
        """Compile the coder, or take it from the cache."""
        turn = Turn(np.full((1, 8, 2), 500, np.uint16), np.arange(8, dtype=np.uint16) * 20)
        beams = Beams((-1.0, 1.0), (0.0, 0.0), (0.0, 0.0))
        self.decode_cloud(self._stream(Returns(beams, Layout((0, 1)), (turn, turn)), 1))

    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        return self._stream(returns, step_in_quanta(returns, parameters))

    def _stream(self, returns: Returns, step: int) -> bytes:
        from puckbench.puck.stream import check_ranges, ranges_of
        from puckbench.puck.turns import Settings, TurnEncoder

        chosen = self.options
        settings = Settings(
            step=step,
            lmbda=chosen.lmbda * step**2 if step > 1 else 0.0,
            times=chosen.times,
            reflectivities=chosen.reflectivities,
            effort=chosen.effort,
        )
        encoder = TurnEncoder(returns.layout, settings)
        turns = [encoder.encode(turn) for turn in returns.turns]
        stream = stream_of(
            [
                Record(Kind.LAYOUT, packed(returns.layout)),
                Record(Kind.BEAMS, packed_beams(returns)),
                *(Record(Kind.TURN, turn) for turn in turns),
            ]
        )
        check_ranges(sum(ranges_of(returns.layout, turn) for turn in turns), len(stream))
        return stream

    def _decode_returns(self, stream: bytes) -> Returns:
        return self._decode_with_steps(stream)[0]

    def _decode_with_steps(self, stream: bytes) -> tuple[Returns, list[float]]:
        """The returns of a stream, and the step of each turn's ranges, m."""
        from puckbench.puck.stream import check_ranges, ranges_of
        from puckbench.puck.turns import TurnDecoder

        records = read_records(BytesIO(stream))
        layout = unpacked(_body(records, Kind.LAYOUT))[0]
        bare = unpacked_beams(_body(records, Kind.BEAMS), layout)
        decoder = TurnDecoder(layout)
        bodies = [_turn_body(record) for record in records if record.kind != Kind.END]
        check_ranges(sum(ranges_of(layout, body) for body in bodies), len(stream))
        turns, steps = [], []
        for body in bodies:
            turns.append(decoder.decode(body))
            steps.append(decoder.step * bare.quantum_m)
        return replace(bare, turns=tuple(turns)), steps


def _body(records: Iterator[Record], kind: Kind) -> bytes:
    """The body of the next record, which is of a kind."""
    record = next(records)
    if record.kind != kind:
        raise InputError(
            "is no stream of returns alone; a compressed recording has to be decompressed first"
        )
    return record.body


def _turn_body(record: Record) -> bytes:
    if record.kind != Kind.TURN:
        raise InputError(DAMAGED)
    return record.body
