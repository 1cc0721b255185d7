"""Returns of a spinning sensor, real or virtual, as the integers that the sensor reports.

A `Returns` object holds revolutions of the sensor, each as an image of firing columns by lasers; a
column is one firing of all lasers. A `FiringTable` is the form of this object in a file: a Parquet
table with one row for each firing of a laser, with or without a return. By contrast, a
`pointkit.lidar.return_table.ReturnTable` holds the returns as points in metres and seconds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from pointkit.column_tables import (
    ColumnSpecs,
    ColumnTable,
    TableSchema,
    read_column_table,
    write_column_table,
)
from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.turns import (
    CENTIDEGREES,
    Layout,
    Turn,
    check_turn,
    clock_steps,
    has_wide_ranges,
)

USUAL_QUANTUM_M = 0.002
"""Velodyne's range quantum, the default for sensors that state none."""
_LARGEST_INCREASE_DEG = 1.0
"""A larger azimuth increase between blocks, unless it is one step, means missing blocks."""

HOUR_US = 3.6e9
_UNKNOWN = -1
_ORDER = "columns from 0, in each lasers from 0, of each the kinds of return"
_FAR_M, _NEAR_RIGHT_M, _NEAR_FORWARD_M = 25.04, 2.40, 1.93
"""Distances at which an HDL-64E is calibrated."""

Firing = Literal["sequential", "simultaneous"]
_Number = TypeVar("_Number", bound=np.integer)


@dataclass(frozen=True)
class Beams:
    """Directions and firing times of a sensor's lasers; each tuple has one item for each laser.

    An empty tuple means that the value is 0 for all lasers, unless stated otherwise.

    Parameters
    ----------
    elevations_deg
        Angles above the horizontal plane, degrees.
    heights_mm
        Heights above the sensor's origin at which beams start (Velodyne's vertical corrections),
        mm.
    delays
        Firing times after the start of a column, as fractions of the time between two columns.
    clockwise
        Whether the sensor rotates clockwise, seen from above. Azimuths start at 0 for the forward
        direction (y) and increase in the direction of rotation.
    azimuths_deg
        Azimuths relative to the azimuth of the column, degrees.
    sideways_mm
        Distances of beams from the sensor's axis, in the direction of rotation, mm.
    radial_mm
        Distances from the sensor's axis at which beams start and from which ranges are measured, in
        the direction of the column's azimuth, mm.
    range_mm
        Lengths that are added to ranges, mm.
    near_right_mm, near_forward_mm
        Lengths that are added to near ranges, mm: `near_right_mm` at x = 2.4 m to compute x, and
        `near_forward_mm` at y = 1.93 m to compute y. Both change linearly to `range_mm` at 25.04 m
        (HDL-64E manual). Empty: the same as `range_mm`.
    """

    elevations_deg: tuple[float, ...]
    heights_mm: tuple[float, ...]
    delays: tuple[float, ...]
    clockwise: bool = True
    azimuths_deg: tuple[float, ...] = ()
    sideways_mm: tuple[float, ...] = ()
    radial_mm: tuple[float, ...] = ()
    range_mm: tuple[float, ...] = ()
    near_right_mm: tuple[float, ...] = ()
    near_forward_mm: tuple[float, ...] = ()

    @classmethod
    def of(cls, sensor: Sensor, firing: Firing = "sequential", is_virtual: bool = False) -> Self:
        """Return the beams of a sensor.

        Parameters
        ----------
        sensor
            Description of the sensor.
        firing
            Whether the lasers of a column fire one after the other (``"sequential"``), as in a real
            sensor, or all at once.
        is_virtual
            Whether the beams are those of virtual scans: all rays start at the sensor's origin, the
            sensor rotates counter-clockwise, and corrections of lasers are ignored.
        """
        none, delays = (0.0,) * sensor.lasers, (0.0,) * sensor.lasers
        if firing == "sequential":
            sequence = sensor.firing_sequence_us or np.inf
            delays = tuple(float(time / sequence) for time in sensor.firing_times_us)
        if is_virtual:
            return cls(sensor.laser_elevation_deg, none, delays, clockwise=False)
        return cls(
            sensor.laser_elevation_deg,
            sensor.vertical_correction_mm or none,
            delays,
            azimuths_deg=sensor.laser_azimuth_deg or (),
            sideways_mm=tuple(-each for each in sensor.horizontal_correction_mm or ()),
            range_mm=sensor.distance_correction_mm or (),
            near_right_mm=sensor.distance_correction_x_mm or (),
            near_forward_mm=sensor.distance_correction_y_mm or (),
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
class FiringTable(ColumnTable):
    """File form of `Returns`: a table with one row for each firing of a laser.

    Firings without a return have a row, too. Rows are in the order of revolutions, columns and
    lasers. In dual return mode, i.e. if the sensor reports two returns of a beam, a firing has one
    row for each of them.
    """

    schema = TableSchema("table of firings", "puckbench_firings", FIRING_COLUMNS)


class _FiringTableInSteps(FiringTable):
    _azimuth = ("<i4", "step (see metadata)", FIRING_COLUMNS["azimuth"][2])
    schema = replace(FiringTable.schema, columns={**FIRING_COLUMNS, "azimuth": _azimuth})


@dataclass(frozen=True)
class Returns:
    """Revolutions of a spinning sensor as integers, and its beams; some codecs code this object.

    The sensor's coordinates are x right, y forward, z up. The distance of a return from the start
    of its beam is the integer range times `quantum_m`, plus `range_offset_m` and the beam's
    `range_mm`. ``len(returns)`` is the number of returns.

    Parameters
    ----------
    beams
        Directions and firing times of the lasers.
    layout
        Arrangement of lasers and columns in the images of all revolutions.
    turns
        The revolutions, in chronological order.
    quantum_m
        Length of one unit of the integer ranges, m.
    sensor
        Name of the sensor.
    range_offset_m
        Length that is added to all ranges, m.

    Raises
    ------
    InputError
        The arrays of a revolution do not have the shapes of the layout, or the numbers of lasers in
        `beams` and `layout` differ.
    """

    beams: Beams
    layout: Layout
    turns: tuple[Turn, ...]
    quantum_m: float = USUAL_QUANTUM_M
    sensor: str = ""
    range_offset_m: float = 0.0

    def __post_init__(self) -> None:
        if self.beams.lasers != self.layout.lasers:
            raise InputError(f"{self.beams.lasers} beams for {self.layout.lasers} lasers")
        more = astuple(self.beams)[4:]
        if any(len(values) not in (0, self.layout.lasers) for values in more):
            raise InputError("azimuths or offsets are not one for each laser of the layout")
        for turn in self.turns:
            check_turn(turn, self.layout)

    def __len__(self) -> int:
        """Return the number of returns; two equal returns of a beam count once."""
        return sum(int(np.count_nonzero(_returned(turn))) for turn in self.turns)

    @property
    def firings(self) -> int:
        """Number of firings of single lasers, with and without a return."""
        return sum(turn.ranges[0].size for turn in self.turns)

    def distances(self, turn: Turn) -> Floats:
        """Return the distances of a revolution's firings, m; 0 for a firing without a return.

        The shape is (kinds of return, columns, lasers).
        """
        distances: Floats = turn.ranges.astype(np.float64) * self.quantum_m
        if self.range_offset_m or self.beams.range_mm:
            more = self.range_offset_m + np.asarray(self.beams.range_mm or 0.0) / 1000
            distances += np.where(turn.ranges > 0, more, 0.0)
        return distances

    def points(self, distances: Sequence[Floats] | None = None) -> Floats:
        """Compute the points of the returns.

        The conversion is that of the VLP-16 User Manual 63-9243 Rev. E, section 9.2.

        Parameters
        ----------
        distances
            Distances in m to use in place of the ranges: one array for each revolution, in the
            shape of its ranges.

        Returns
        -------
        array
            Points in the sensor's coordinates, (n, 3), m, in the order of revolutions, columns,
            lasers and kinds of return. Firings without a return have no point.
        """
        if distances is None:
            distances = [self.distances(turn) for turn in self.turns]
        parts = [self._points(*each) for each in zip(self.turns, distances, strict=True)]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    def indices(self, turn: Turn) -> tuple[NDArray[np.intp], ...]:
        """Return the column, laser and kind of each return of a revolution, as three arrays (n,).

        The returns are in the order of `points`.
        """
        return np.nonzero(_returned(turn).transpose(1, 2, 0))

    def reflectivities(self) -> NDArray[np.uint8] | None:
        """Return the reflectivity of each return, (n,), in the order of `points`.

        The result is None if a revolution has no reflectivities.
        """
        parts = []
        for turn in self.turns:
            if turn.reflectivities is None:
                return None
            columns, lasers, kinds = self.indices(turn)
            parts.append(turn.reflectivities[kinds, columns, lasers])
        return np.concatenate(parts) if parts else None

    def _points(self, turn: Turn, distances: Floats) -> Floats:
        columns, lasers, kinds = self.indices(turn)
        distance = distances[kinds, columns, lasers]
        azimuth = self.azimuths(turn)[columns, lasers]
        elevation = np.radians(self.beams.elevations_deg)[lasers]
        level = distance * np.cos(elevation)
        right, forward = level * np.sin(azimuth), level * np.cos(azimuth)
        up = distance * np.sin(elevation)
        if self.beams.near_right_mm:
            to_right, to_forward = self._near(distance, right, forward, lasers)
            up += (to_right + to_forward) / 2 * np.sin(elevation)
            right += to_right * np.cos(elevation) * np.sin(azimuth)
            forward += to_forward * np.cos(elevation) * np.cos(azimuth)
        if self.beams.sideways_mm:
            sideways = np.asarray(self.beams.sideways_mm)[lasers] / 1000
            right, forward = (
                right + sideways * np.cos(azimuth),
                forward - sideways * np.sin(azimuth),
            )
        if self.beams.radial_mm:
            radial = np.asarray(self.beams.radial_mm)[lasers] / 1000
            turned = self.column_azimuths(turn)[columns, lasers]
            right, forward = right + radial * np.sin(turned), forward + radial * np.cos(turned)
        height = np.asarray(self.beams.heights_mm)[lasers] / 1000
        return np.column_stack(
            [
                right if self.beams.clockwise else -right,
                forward,
                up + height,
            ]
        )

    def _near(
        self, distance: Floats, right: Floats, forward: Floats, lasers: NDArray[np.intp]
    ) -> tuple[Floats, Floats]:
        """Return the near corrections along x and along y, each (n,), m.

        The formula is that of velodyne_decoder: heights get the mean of both corrections. In the
        manual, heights get the correction along y.
        """
        beams = self.beams
        far = np.asarray(beams.range_mm or (0.0,) * beams.lasers)[lasers] / 1000
        is_near = distance - far < _FAR_M

        def addition(along: Floats, near_m: float, near_mm: tuple[float, ...]) -> Floats:
            share = (_FAR_M - np.abs(along)) / (_FAR_M - near_m)
            return np.where(is_near, share * (np.asarray(near_mm)[lasers] / 1000 - far), 0.0)

        return (
            addition(right, _NEAR_RIGHT_M, beams.near_right_mm),
            addition(forward, _NEAR_FORWARD_M, beams.near_forward_mm),
        )

    def azimuths(self, turn: Turn) -> Floats:
        """Return the azimuth of each firing of a revolution, (columns, lasers), rad."""
        fired = self._fired_deg(turn)
        if self.beams.azimuths_deg:
            fired = fired + np.asarray(self.beams.azimuths_deg)
        return np.asarray(np.radians(fired))

    def column_azimuths(self, turn: Turn) -> Floats:
        """Return the azimuth of each firing, (columns, lasers), rad, without the offsets of lasers.

        These offsets are `Beams.azimuths_deg`, which `azimuths` adds.
        """
        return np.asarray(np.radians(self._fired_deg(turn)))

    def _fired_deg(self, turn: Turn) -> Floats:
        # The sensor reports the azimuth of a block's first firing; others are interpolated in time.
        blocks, steps_per_deg = turn.azimuths.astype(np.float64), self.layout.azimuth_steps / 360
        rise = np.mod(np.diff(blocks), self.layout.azimuth_steps)
        rise = np.concatenate([rise, rise[-1:] if len(rise) else [0.0]])
        usual = rise <= max(_LARGEST_INCREASE_DEG * steps_per_deg, 1)
        rise = np.where(usual, rise, np.median(rise[usual]) if usual.any() else 0.0)
        per_block = self.layout.columns_per_block
        share = (np.arange(per_block)[:, None] + np.asarray(self.beams.delays)) / per_block
        fired = (blocks[:, None, None] + rise[:, None, None] * share) / steps_per_deg
        return np.asarray(fired.reshape(-1, self.layout.lasers))

    @property
    def columns_per_turn(self) -> int:
        """Number of columns in a whole revolution, computed from the usual azimuth step."""
        steps = self.layout.azimuth_steps
        rises = [np.mod(np.diff(turn.azimuths.astype(int)), steps) for turn in self.turns]
        increases = np.concatenate(rises) if rises else np.zeros(0, int)
        rising = increases[increases > 0]
        if not len(rising):
            return 1
        median = float(np.median(rising))
        usual = rising[np.abs(rising - median) <= 0.5 * median]
        return max(round(steps * self.layout.columns_per_block / float(usual.mean())), 1)

    def split(self) -> Iterator[Returns]:
        """Yield each revolution as a `Returns` object of its own."""
        for turn in self.turns:
            yield replace(self, turns=(turn,))

    @property
    def seconds(self) -> float | None:
        """Duration of all revolutions by the sensor's clock, s; None if the times are unknown.

        The clock restarts every hour.
        """
        times = [turn.times for turn in self.turns if turn.times is not None]
        clock = np.concatenate(times).astype(np.float64) if times else np.zeros(0)
        if len(clock) < 2:
            return None
        steps = clock_steps(clock, HOUR_US)
        span = float(np.ptp(np.concatenate([[0.0], np.cumsum(steps)])))
        return span * len(clock) / len(steps) * 1e-6 or None


def _returned(turn: Turn) -> NDArray[np.bool_]:
    """Return the mask (kinds, columns, lasers) of returns; equal returns of a beam count once."""
    is_return = turn.ranges > 0
    if len(is_return) > 1:
        is_return[1:] &= turn.ranges[1:] != turn.ranges[:1]
    return is_return


def write_firings(path: Path, returns: Returns) -> None:
    """Write returns without loss to a Parquet file, as a `FiringTable`."""
    layout = returns.layout
    parts = [_rows(number, turn, layout) for number, turn in enumerate(returns.turns)]
    columns = {
        name: np.concatenate([part[name] for part in parts]).astype(kind)
        for name, (kind, *_) in FIRING_COLUMNS.items()
    }
    about = {
        "beams": _described(returns.beams),
        "layout": _described(layout),
        "quantum_m": returns.quantum_m,
        "sensor": returns.sensor,
    }
    if returns.range_offset_m:
        about["range_offset_m"] = returns.range_offset_m
    if any(has_wide_ranges(turn) for turn in returns.turns):
        about["range_bits"] = 32
    in_centidegrees = layout.azimuth_steps == CENTIDEGREES
    kind = FiringTable if in_centidegrees else _FiringTableInSteps
    write_column_table(path, kind(columns, about))


def _described(part: Beams | Layout) -> dict[str, Any]:
    """Return the fields of `part` by name; recently added fields are left out at their default."""
    later: dict[str, Any] = dict.fromkeys(
        ("radial_mm", "range_mm", "near_right_mm", "near_forward_mm", "shifts"), ()
    )
    later["azimuth_steps"] = CENTIDEGREES
    return {name: value for name, value in asdict(part).items() if later.get(name) != value}


def _rows(number: int, turn: Turn, layout: Layout) -> dict[str, NDArray[Any]]:
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
    """Read returns from a Parquet file that `write_firings` wrote.

    Returns
    -------
    Returns
        The same returns that were written.

    Raises
    ------
    InputError
        The file is not such a table, its rows are not in order, or a sensor cannot report one of
        the values.
    """
    table = read_column_table(path, FiringTable)
    with naming(path):
        try:
            about = table.about
            beams = Beams(**{key: _tuples(value) for key, value in about["beams"].items()})
            layout = Layout(**{key: _tuples(value) for key, value in about["layout"].items()})
            turns = tuple(_turns(table, layout))
            offset = float(about.get("range_offset_m", 0.0))
            return Returns(beams, layout, turns, about["quantum_m"], about["sensor"], offset)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError("not a whole table of firings") from error


def returns_file(cloud: Path) -> Path:
    """Return the path of the Parquet file that holds the returns of a cloud file.

    The path differs from the cloud's only in the suffix ``.parquet``.
    """
    return cloud.with_suffix(".parquet")


def with_returns(cloud: PointCloud, path: Path) -> PointCloud:
    """Return the cloud together with the returns in the file beside it (`returns_file`), if any.

    Parameters
    ----------
    cloud
        The cloud.
    path
        File of the cloud.
    """
    beside = returns_file(path)
    return replace(cloud, returns=read_firings(beside)) if beside.exists() else cloud


def _tuples(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _turns(table: FiringTable, layout: Layout) -> Iterator[Turn]:
    width = np.uint32 if table.about.get("range_bits") == 32 else np.uint16
    _check_firings(table, layout, int(np.iinfo(width).max))
    edges = np.flatnonzero(np.diff(table["turn"], prepend=-1, append=-1))
    for first, end in pairwise(edges):
        shape = (-1, layout.lasers, layout.kinds)
        image = {name: part[first:end].reshape(shape) for name, part in table.columns.items()}
        with naming(f"turn {image['turn'].flat[0]}"):
            _check_order(image)
            per_block = layout.columns_per_block
            azimuths = _shared(image, "azimuth", per_block)
            times = _known("time", _shared(image, "time", per_block * layout.blocks_per_time))
            reflectivities = _known("reflectivity", image["reflectivity"].transpose(2, 0, 1))
        yield Turn(
            np.ascontiguousarray(image["distance"].transpose(2, 0, 1)).astype(width),
            azimuths.astype(np.uint16),
            None if times is None else times.astype(np.uint32),
            None
            if reflectivities is None
            else np.ascontiguousarray(reflectivities).astype(np.uint8),
        )


def _check_order(image: Mapping[str, NDArray[Any]]) -> None:
    columns, lasers, kinds = np.indices(image["distance"].shape)
    order = {"column": columns, "laser_id": lasers, "return_kind": kinds}
    if any((image[name] != places).any() for name, places in order.items()):
        raise InputError(f"its rows are not in order: {_ORDER}")


def _shared(image: Mapping[str, NDArray[Any]], name: str, columns: int) -> NDArray[Any]:
    """Return one value for each `columns` columns; raise InputError if these have several."""
    values = image[name]
    first: NDArray[Any] = values[::columns, 0, 0]
    if (values != np.repeat(first, columns)[: len(values), None, None]).any():
        raise InputError(f"column {name} has several values in a block or packet")
    return first


def _check_firings(table: FiringTable, layout: Layout, most_range: int) -> None:
    limits = {
        "azimuth": (0, layout.azimuth_steps - 1),
        "time": (_UNKNOWN, int(np.iinfo(np.uint32).max)),
        "distance": (0, most_range),
        "reflectivity": (_UNKNOWN, int(np.iinfo(np.uint8).max)),
    }
    for name, (low, high) in limits.items():
        values = table[name]
        if (wrong := (values < low) | (values > high)).any():
            value = values[np.argmax(wrong)]
            raise InputError(f"column {name} has {value}, not one of {low} to {high}")
    if (np.diff(table["turn"], prepend=0) < 0).any():
        raise InputError("turns are not in order")


def _known(name: str, values: NDArray[_Number]) -> NDArray[_Number] | None:
    """Return the values, or None if all are -1; raise InputError if only some are -1."""
    unknown = values == _UNKNOWN
    if unknown.any() and not unknown.all():
        raise InputError(f"column {name} has {_UNKNOWN} (not known) in a part of a turn")
    return None if unknown.any() else values
