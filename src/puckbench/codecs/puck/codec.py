"""`puck` as a codec of the benchmark: ranges and azimuths of returns, without loss or with little.

The sensor's beams stand in the stream: by the name of a sensor that puckbench ships, or all angles.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from functools import cache
from io import BytesIO
from typing import Literal

import numpy as np
from pydantic import Field

from puckbench import __version__
from puckbench.codecs.base import Pace, Parameters, lengths
from puckbench.codecs.common.byte_io import Reader, base_128
from puckbench.codecs.puck.layout import packed, unpacked
from puckbench.codecs.puck.stream import MAGIC, Kind, Record, read_records, start
from puckbench.codecs.puck.turns import Settings, TurnDecoder, TurnEncoder
from puckbench.codecs.registry import CODECS
from puckbench.codecs.returns_codec import ReturnsCodec
from puckbench.core.errors import InputError
from puckbench.core.models import Model
from puckbench.lidar.returns import Beams, Firing, Returns
from puckbench.lidar.sensor import load_sensor, sensor_names
from puckbench.lidar.turns import Layout, Turn

_DAMAGED = "the stream is damaged"
_QUANTUM_UNIT_M = 1e-7
_MOST_NAME_BYTES = 255
_USES: tuple[tuple[Firing, bool], ...] = (
    ("own_moment", False),
    ("together", True),
    ("own_moment", True),
)
"""How a shipped sensor is used: real, virtual as BlenSor has it, virtual with firing times."""


class PuckOptions(Model):
    """What is coded of returns, and with how much effort."""

    effort: Literal["fast", "normal", "thorough"] = Field(
        "normal", description="how many estimates are taken of each range"
    )
    lmbda: float = Field(
        0.0,
        ge=0,
        description="Lagrangian weight of rate against squared error, in squared steps a nat; "
        "above 0 ranges may be off by more than half a step (lossy rates only)",
    )
    times: bool = Field(False, description="code the times of packets too")
    reflectivities: bool = Field(False, description="code reflectivities too")


@CODECS.register("puck")
class Puck(ReturnsCodec):
    """Ranges by laser and firing column, predicted and coded by context mixing.

    A rate is the step of the ranges; the sensor's own (2 mm) is without loss. No return is lost.
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
        self.decode_returns(self._stream(Returns(beams, Layout((0, 1)), (turn, turn)), 1))

    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        return self._stream(returns, max(1, round(parameters["step_m"] / returns.quantum_m)))

    def _stream(self, returns: Returns, step: int) -> bytes:
        chosen = self.options
        settings = Settings(
            step=step,
            lmbda=chosen.lmbda * step**2 if step > 1 else 0.0,
            times=chosen.times,
            reflectivities=chosen.reflectivities,
            effort=chosen.effort,
        )
        encoder = TurnEncoder(returns.layout, settings)
        records = [
            Record(Kind.LAYOUT, packed(returns.layout)),
            Record(Kind.BEAMS, _packed_beams(returns)),
            *(Record(Kind.TURN, encoder.encode(turn)) for turn in returns.turns),
            Record(Kind.END, b""),
        ]
        return b"".join([start(), *(each.packed() for each in records)])

    def _decode_returns(self, stream: bytes) -> Returns:
        records = read_records(BytesIO(stream))
        layout = unpacked(_body(records, Kind.LAYOUT))[0]
        bare = _unpacked_beams(_body(records, Kind.BEAMS), layout)
        decoder = TurnDecoder(layout)
        turns = []
        for record in records:
            if record.kind not in (Kind.TURN, Kind.END):
                raise InputError(_DAMAGED)
            if record.kind == Kind.TURN:
                turns.append(decoder.decode(record.body))
        return Returns(bare.beams, layout, tuple(turns), bare.quantum_m, bare.sensor)


def _body(records: Iterator[Record], kind: Kind) -> bytes:
    """The body of the next record, which is of a kind."""
    record = next(records)
    if record.kind != kind:
        is_recording = kind == Kind.BEAMS
        raise InputError("a compressed recording: decompress it" if is_recording else _DAMAGED)
    return record.body


@cache
def _shipped() -> dict[tuple[Beams, str], tuple[str, int]]:
    """Name of the shipped sensor and how it is used, by its beams and title."""
    return {
        (_beams(name, use), load_sensor(name).name): (name, use)
        for name in sensor_names()
        for use in range(len(_USES))
    }


def _beams(name: str, use: int) -> Beams:
    firing, is_virtual = _USES[use]
    return Beams.of(load_sensor(name), firing, is_virtual)


def _packed_beams(returns: Returns) -> bytes:
    """The quantum and the beams: a name and a check of the angles, or all of them."""
    quantum = base_128(round(returns.quantum_m / _QUANTUM_UNIT_M))
    known = _shipped().get((returns.beams, returns.sensor))
    angles = _angles(returns.beams)
    if known:
        name, use = known
        check = zlib.crc32(angles).to_bytes(4, "little")
        return quantum + bytes([use + 1, len(name)]) + name.encode() + check
    title = returns.sensor.encode()[:_MOST_NAME_BYTES]
    head = bytes([0, len(title)]) + title + bytes([returns.beams.clockwise])
    return quantum + head + angles


def _angles(beams: Beams) -> bytes:
    return np.array([beams.elevations_deg, beams.heights_mm, beams.delays], "<f8").tobytes()


def _unpacked_beams(body: bytes, layout: Layout) -> Returns:
    """Returns without turns, with the beams of `_packed_beams`."""
    reader = Reader(body)
    quantum = reader.number() * _QUANTUM_UNIT_M
    use, length = reader.take(2)
    name = reader.take(length).decode("utf-8", "replace")
    if use:
        if use > len(_USES) or name not in sensor_names():
            raise InputError(f"the stream is damaged, or of a sensor that is not known ({name!r})")
        beams, sensor = _beams(name, use - 1), load_sensor(name).name
        if zlib.crc32(_angles(beams)).to_bytes(4, "little") != reader.rest():
            raise InputError(f"the stream was made with other angles of the sensor {name}")
        return Returns(beams, layout, (), quantum, sensor)
    clockwise = reader.take(1)[0] == 1
    angles = np.frombuffer(reader.take(24 * layout.lasers), "<f8").reshape(3, -1)
    if not np.isfinite(angles).all() or not quantum > 0:
        raise InputError(_DAMAGED)
    elevations, heights, delays = (tuple(row.tolist()) for row in angles)
    return Returns(Beams(elevations, heights, delays, clockwise), layout, (), quantum, name)
