"""Returns of a spinning sensor, real or virtual, in its own numbers and frame.

One type for recordings and virtual scans: turns as images of firing columns and lasers, and where
the lasers point. On disk it is a Parquet file with a row for each firing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError, naming
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.io.return_tables import (
    ColumnSpecs,
    ReturnTable,
    TableSchema,
    read_return_table,
    write_return_table,
)
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.turns import CENTIDEGREES, Layout, Turn, check_turn, clock_steps

USUAL_QUANTUM_M = 0.002
"""Step of Velodyne's ranges, for sensors that state none."""
_GREATEST_RISE = 100
"""Of the azimuth from block to block, in 0.01 degrees; a greater one shows missing blocks."""

_HOUR_US = 3.6e9

Firing = Literal["own_moment", "together"]


@dataclass(frozen=True)
class Beams:
    """Where a sensor's lasers point, and when they fire.

    Parameters
    ----------
    elevations_deg
        (lasers,) of each laser, by its id.
    heights_mm
        (lasers,) above the sensor's origin (Velodyne's vertical corrections).
    delays
        (lasers,) from 0 to below 1: the share of a column's time after which each laser fires.
    clockwise
        Whether the sensor turns clockwise seen from above, as real ones do; azimuths always count
        in the direction in which it turns, from forward (y).
    azimuths_deg
        (lasers,) by which each laser is turned against the column, in that direction; empty: 0.
    sideways_mm
        (lasers,) by which each beam passes the axis, in that direction; empty: 0.
    """

    elevations_deg: tuple[float, ...]
    heights_mm: tuple[float, ...]
    delays: tuple[float, ...]
    clockwise: bool = True
    azimuths_deg: tuple[float, ...] = ()
    sideways_mm: tuple[float, ...] = ()

    @classmethod
    def of(cls, sensor: Sensor, firing: Firing = "own_moment", is_virtual: bool = False) -> Self:
        """The beams of a sensor.

        Parameters
        ----------
        sensor
            The sensor.
        firing
            Whether its lasers fire one after the other, as real ones do, or together, as BlenSor's.
        is_virtual
            All rays start at the sensor's origin, and it turns counter-clockwise.
        """
        lasers = sensor.lasers
        heights = None if is_virtual else sensor.vertical_correction_mm
        delays = (0.0,) * lasers
        if firing == "own_moment":
            sequence = sensor.firing_sequence_us or np.inf
            delays = tuple(float(time / sequence) for time in sensor.firing_times_us)
        return cls(
            sensor.laser_elevation_deg, heights or (0.0,) * lasers, delays, clockwise=not is_virtual
        )

    @property
    def lasers(self) -> int:
        """Number of lasers."""
        return len(self.elevations_deg)


FIRING_COLUMNS: ColumnSpecs = {
    "turn": ("<i4", "", "turn, from 0"),
    "column": ("<i4", "", "firing column of the turn, from 0"),
    "laser_id": ("<i2", "", "laser, from 0"),
    "return_kind": ("<i2", "", "0 the first of the returns of a beam (strongest), 1 the other"),
    "azimuth": ("<i4", "0.01 deg", "of the column's block, in the direction of rotation"),
    "time": ("<i8", "us", "by the sensor's clock, of the column's packet; -1: not known"),
    "distance": ("<i4", "quantum (see metadata)", "measured; 0: no return"),
    "reflectivity": ("<i2", "", "0..100 diffuse, 101..255 retro-reflector; -1: not known"),
}


@dataclass(frozen=True)
class FiringTable(ReturnTable):
    """Firings, with or without return, in the order of turns, columns, lasers and kinds."""

    schema = TableSchema("table of firings", "puckbench_firings", FIRING_COLUMNS)


@dataclass(frozen=True)
class Returns:
    """Returns of a spinning sensor in its own frame: x right, y forward, z up.

    Parameters
    ----------
    beams
        Where the lasers point.
    layout
        How firings make an image.
    turns
        Of that layout, in the order of time.
    quantum_m
        Step of the ranges.
    sensor
        Its name, for people.

    Raises
    ------
    InputError
        A turn's arrays have not the layout's shapes, or beams and lasers differ in number.
    """

    beams: Beams
    layout: Layout
    turns: tuple[Turn, ...]
    quantum_m: float = USUAL_QUANTUM_M
    sensor: str = ""

    def __post_init__(self) -> None:
        if self.beams.lasers != self.layout.lasers:
            raise InputError(f"{self.beams.lasers} beams for {self.layout.lasers} lasers")
        more = (self.beams.azimuths_deg, self.beams.sideways_mm)
        if any(len(one) not in (0, self.layout.lasers) for one in more):
            raise InputError("azimuths or offsets of other lasers than the layout's")
        for turn in self.turns:
            check_turn(turn, self.layout)

    def __len__(self) -> int:
        """Number of returns; two equal ones of a beam count once."""
        return sum(int(np.count_nonzero(_returned(turn))) for turn in self.turns)

    @property
    def firings(self) -> int:
        """Number of firings, with or without return."""
        return sum(turn.ranges[0].size for turn in self.turns)

    def points(self, distances: Sequence[Floats] | None = None) -> Floats:
        """Points (n, 3) in m, in the order of turns, columns, lasers and kinds.

        Parameters
        ----------
        distances
            In place of each turn's ranges, in their shape, m.

        References
        ----------
        VLP-16 User Manual 63-9243 Rev. E, section 9.2: x = R cos(w) sin(a), y = R cos(w) cos(a),
        z = R sin(w) + the laser's vertical correction.
        """
        if distances is None:
            distances = [turn.ranges.astype(np.float64) * self.quantum_m for turn in self.turns]
        parts = [self._points(*each) for each in zip(self.turns, distances, strict=True)]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    def _points(self, turn: Turn, distances: Floats) -> Floats:
        columns, lasers, kinds = np.nonzero(_returned(turn).transpose(1, 2, 0))
        distance = distances[kinds, columns, lasers]
        azimuth = self.azimuths(turn)[columns, lasers]
        elevation = np.radians(self.beams.elevations_deg)[lasers]
        level = distance * np.cos(elevation)
        right, forward = level * np.sin(azimuth), level * np.cos(azimuth)
        if self.beams.sideways_mm:
            sideways = np.asarray(self.beams.sideways_mm)[lasers] / 1000
            right, forward = (
                right + sideways * np.cos(azimuth),
                forward - sideways * np.sin(azimuth),
            )
        height = np.asarray(self.beams.heights_mm)[lasers] / 1000
        return np.column_stack(
            [
                right if self.beams.clockwise else -right,
                forward,
                distance * np.sin(elevation) + height,
            ]
        )

    def azimuths(self, turn: Turn) -> Floats:
        """Azimuth of each firing of a turn, (columns, lasers), in rad, in the turning direction.

        A block's azimuth is that of its first firing; those after it lie between it and the next
        block's, in proportion to the time.
        """
        blocks = turn.azimuths.astype(np.float64)
        rise = np.mod(np.diff(blocks), CENTIDEGREES)
        rise = np.concatenate([rise, rise[-1:] if len(rise) else [0.0]])
        usual = rise <= _GREATEST_RISE
        rise = np.where(usual, rise, np.median(rise[usual]) if usual.any() else 0.0)
        per_block = self.layout.columns_per_block
        share = (np.arange(per_block)[:, None] + np.asarray(self.beams.delays)) / per_block
        fired = (blocks[:, None, None] + rise[:, None, None] * share) / 100
        if self.beams.azimuths_deg:
            fired = fired + np.asarray(self.beams.azimuths_deg)
        return np.asarray(np.radians(fired.reshape(-1, self.layout.lasers)))

    @property
    def columns_per_turn(self) -> int:
        """Firing columns of a whole turn, from how the azimuth rises between blocks."""
        rises = [np.mod(np.diff(turn.azimuths.astype(int)), CENTIDEGREES) for turn in self.turns]
        every = np.concatenate(rises) if rises else np.zeros(0, int)
        rising = every[every > 0]
        if not len(rising):
            return 1
        median = float(np.median(rising))
        usual = rising[np.abs(rising - median) <= 0.5 * median]
        return max(round(CENTIDEGREES * self.layout.columns_per_block / float(usual.mean())), 1)

    def split(self) -> Iterator[Returns]:
        """Each turn as returns of its own."""
        for turn in self.turns:
            yield replace(self, turns=(turn,))

    @property
    def seconds(self) -> float | None:
        """How long the turns took by the sensor's clock; None where they have no times.

        From the earliest packet to the latest, whatever their order; the time of one packet is
        that of the others on average. The clock starts again every hour.
        """
        times = [turn.times for turn in self.turns if turn.times is not None]
        every = np.concatenate(times).astype(np.float64) if times else np.zeros(0)
        if len(every) < 2:
            return None
        steps = clock_steps(every, _HOUR_US)
        span = float(np.ptp(np.concatenate([[0.0], np.cumsum(steps)])))
        return span * len(every) / len(steps) * 1e-6 or None


def _returned(turn: Turn) -> NDArray[np.bool_]:
    """Which pixels (kinds, columns, lasers) are returns, repeated ones left out."""
    found = turn.ranges > 0
    if len(found) > 1:
        found[1:] &= turn.ranges[1:] != turn.ranges[:1]
    return found


def write_firings(path: Path, returns: Returns) -> None:
    """Write returns as a Parquet file, whole or not at all."""
    layout = returns.layout
    parts = [_rows(number, turn, layout) for number, turn in enumerate(returns.turns)]
    columns = {
        name: np.concatenate([part[name] for part in parts]).astype(kind)
        for name, (kind, *_) in FIRING_COLUMNS.items()
    }
    about = {
        "beams": asdict(returns.beams),
        "layout": asdict(layout),
        "quantum_m": returns.quantum_m,
        "sensor": returns.sensor,
    }
    write_return_table(path, FiringTable(columns, about))


def _rows(number: int, turn: Turn, layout: Layout) -> dict[str, NDArray[Any]]:
    """The rows of a turn: kinds change fastest, then lasers, then columns."""
    kinds, columns, lasers = turn.ranges.shape
    shape = (columns, lasers, kinds)
    block = np.arange(columns) // layout.columns_per_block
    times = np.full(columns, -1, np.int64)
    if turn.times is not None:
        times = turn.times.astype(np.int64)[block // layout.blocks_per_time]
    reflectivity = np.full(turn.ranges.shape, -1, np.int16)
    if turn.reflectivities is not None:
        reflectivity = turn.reflectivities.astype(np.int16)
    shaped: dict[str, NDArray[Any]] = {
        "turn": np.full((1, 1, 1), number),
        "column": np.arange(columns)[:, None, None],
        "laser_id": np.arange(lasers)[:, None],
        "return_kind": np.arange(kinds),
        "azimuth": turn.azimuths[block][:, None, None],
        "time": times[:, None, None],
        "distance": turn.ranges.transpose(1, 2, 0),
        "reflectivity": reflectivity.transpose(1, 2, 0),
    }
    return {name: np.broadcast_to(part, shape).ravel() for name, part in shaped.items()}


def read_firings(path: Path) -> Returns:
    """Read what `write_firings` wrote.

    Raises
    ------
    InputError
        The file is missing, damaged, or holds something else.
    """
    table = read_return_table(path, FiringTable)
    with naming(path):
        try:
            about = table.about
            beams = Beams(**{key: _tuples(value) for key, value in about["beams"].items()})
            layout = Layout(**{key: _tuples(value) for key, value in about["layout"].items()})
            turns = tuple(_turns(table, layout))
            return Returns(beams, layout, turns, about["quantum_m"], about["sensor"])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError("not a whole table of firings") from error


def returns_file(cloud: Path) -> Path:
    """Where the returns of a cloud lie."""
    return cloud.with_suffix(".parquet")


def with_returns(cloud: PointCloud, path: Path) -> PointCloud:
    """A cloud that was read from a file, with the returns beside it, where there are any."""
    beside = returns_file(path)
    return replace(cloud, returns=read_firings(beside)) if beside.exists() else cloud


def _tuples(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _turns(table: FiringTable, layout: Layout) -> Iterator[Turn]:
    edges = np.flatnonzero(np.diff(table["turn"], prepend=-1, append=-1))
    for first, end in pairwise(edges):
        shape = (-1, layout.lasers, layout.kinds)
        image = {name: part[first:end].reshape(shape) for name, part in table.columns.items()}
        ranges, reflectivity = (
            np.ascontiguousarray(image[name].transpose(2, 0, 1))
            for name in ("distance", "reflectivity")
        )
        per_time = layout.columns_per_block * layout.blocks_per_time
        times = image["time"][::per_time, 0, 0]
        yield Turn(
            ranges.astype(np.uint16),
            image["azimuth"][:: layout.columns_per_block, 0, 0].astype(np.uint16),
            times.astype(np.uint32) if (times >= 0).all() else None,
            reflectivity.astype(np.uint8) if (reflectivity >= 0).all() else None,
        )
