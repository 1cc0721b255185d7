"""Coding of the points of successive clouds, in the same steps for encoding and decoding.

Columns that follow patterns come first, the rings of the lasers before all others. If the points
are on the rays of a spinning sensor, x, y and z become azimuths, ranges, and errors in units of the
last place of the floats. Noisy columns come last, and are predicted from neighbours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.binary_coder import BitCoder
from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.context_mixing import Ints, Words
from pointkit.geometry.cloud import Floats
from puck.clouds.columns import (
    RING_NAMES,
    ColumnPlan,
    SplitColumn,
    Way,
    join_column,
    plan_column,
    plan_ranges,
    singles,
    sorted_bits,
    split_column,
)
from puck.clouds.layout import FLOAT32, Bytes, CloudLayout
from puck.clouds.neighbours import THEN, Rings, neighbours_of, rings_of
from puck.clouds.rays import Rays, Singles, fitted_rays
from puck.clouds.series import (
    FOLLOWERS,
    PREDICTIONS,
    RINGS,
    SeriesModel,
    code_residuals,
    code_series,
    new_series_model,
)
from puck.clouds.values import ValueColumn, ValueModel, blank_column, code_values, new_value_model
from puck.gaps import compress_bytes, decompress_bytes
from puck.options import Effort
from puck.records import check
from puck.turns import PartReader, Parts, PartWriter, with_coder

_FEWEST_POINTS = 64
_MOST_VALUES = 1 << 25
"""Largest number of values in the columns that are not constant."""
_MODELLED = (Way.SERIES, Way.VALUES, Way.RANGE)
_MOST_MODELLED = 32
"""Largest number of columns with models of their own; others are stored as compressed bytes."""
_MOST_MODELS = 40
"""Number of models that are kept, of up to 3 MB each."""
_MOST_RANGE = 1 << 23
_AZIMUTH_BITS, _RESIDUAL_BITS = 17, 64
_VALUE_DECISIONS = 80
"""Approximate maximum number of decisions for a value."""
_PLAIN_STEPS = 1 << 40
_RANGES = -1
"""Number of the ranges among the columns."""
_HAS_RAYS, _HAS_OLD_RAYS, _HAS_MISSING = 1, 2, 4

Indices = NDArray[np.intp]


class _Axes(NamedTuple):
    """Indices of the columns x, y and z, and of the column of rings."""

    x: int
    y: int
    z: int
    ring: int

    @property
    def xyz(self) -> tuple[int, int, int]:
        return self.x, self.y, self.z


class _Aim(NamedTuple):
    """Azimuths of all points (n,), and ranges of the points that are not missing."""

    azimuths: Ints
    ranges: Ints


@dataclass(frozen=True)
class _Plan:
    """How a cloud is coded: its columns, the rays, and the sorted bits of a missing point."""

    columns: tuple[ColumnPlan, ...]
    rays: Rays | None = None
    has_old_rays: bool = False
    has_missing: bool = False
    missing: tuple[int, int, int] = (0, 0, 0)


@dataclass
class _State:
    """Models, and what of the cloud before predicts the next one.

    Models are in the order of their last use. Columns before have the names of their models.
    """

    models: dict[str, Any] = field(default_factory=dict)
    series: dict[str, Ints] = field(default_factory=dict)
    values: dict[str, ValueColumn] = field(default_factory=dict)
    rings: Rings | None = None
    rays: Rays | None = None


class PointCoder:
    """Encoder or decoder of the points of successive clouds of one layout.

    Parameters
    ----------
    layout
        The layout, which has columns.
    effort
        Effort of encoding; a decoder takes that of the encoder.
    rays
        Rays of another cloud, which an encoder tries before it fits others.
    """

    def __init__(self, layout: CloudLayout, effort: Effort, rays: Rays | None = None) -> None:
        self._layout, self._effort, self._first_rays = layout, effort, rays
        self._state, self._axes = _State(), _axes(layout)

    @property
    def rays(self) -> Rays | None:
        """The rays of the last cloud, if it had any."""
        return self._state.rays

    @np.errstate(all="ignore")
    def encode(self, points: Bytes, width: int) -> bytes:
        """Return bytes from which `decode` restores points, or no bytes if there are too many.

        Parameters
        ----------
        points
            Bytes of the points, (n, point_step).
        width
            Number of points in a row of an organised cloud, otherwise 0.
        """
        values = self._layout.all_values(points)
        plan, aim = self._plan(values, width)
        plan = replace(plan, columns=self._limited(plan.columns))
        if _count_values(plan, len(points)) > _MOST_VALUES:
            return b""
        writer, head = PartWriter(), self._packed(plan)
        self._code(plan, values, width, writer, aim)
        return base_128(len(head)) + head + writer.joined()

    @np.errstate(all="ignore")
    def decode(self, reader: Reader, count: int, width: int) -> Bytes:
        """Return the points (count, point_step) that `encode` encoded.

        Raises InputError if the bytes are damaged.
        """
        layout = self._layout
        plan = self._unpacked(Reader(reader.take(reader.number())))
        check(_count_values(plan, count) <= _MOST_VALUES)
        check(sum(column.way in _MODELLED for column in plan.columns) <= _MOST_MODELLED)
        values = [
            np.broadcast_to(one.start, count)
            if one.way == Way.CONSTANT
            else np.zeros(count, np.int64)
            for one in plan.columns
        ]
        self._code(plan, values, width, PartReader(reader), None)
        return layout.points_with(values)

    def _plan(self, values: list[Ints], width: int) -> tuple[_Plan, _Aim | None]:
        axes, aim, there, plan = self._axes, None, None, _Plan(())
        if axes is not None and len(values[0]) >= _FEWEST_POINTS:
            xyz = [values[k] for k in axes.xyz]
            missing, is_missing = _missing(*xyz)
            there = np.flatnonzero(~is_missing)
            plan = replace(plan, has_missing=bool(is_missing.any()), missing=missing)
            plan, aim = self._with_rays(plan, xyz, values[axes.ring], there)
        columns = []
        for k, (column, numbers) in enumerate(zip(self._layout.columns, values, strict=True)):
            one = None
            # Rings come before ranges.
            if aim is not None and axes is not None and there is not None and k != axes.ring:
                is_axis = k in axes.xyz
                one = ColumnPlan(Way.RAY) if is_axis else plan_ranges(numbers, there, aim.ranges)
            columns.append(one or plan_column(column, numbers, width))
        return replace(plan, columns=tuple(columns)), aim

    def _limited(self, plans: tuple[ColumnPlan, ...]) -> tuple[ColumnPlan, ...]:
        """Return plans in which few columns have models, first of all those with names."""
        modelled = [k for k, one in enumerate(plans) if one.way in _MODELLED]
        modelled.sort(key=lambda k: not self._layout.columns[k].name)
        stored = set(modelled[_MOST_MODELLED:])
        return tuple(ColumnPlan(Way.STORED) if k in stored else one for k, one in enumerate(plans))

    def _with_rays(
        self, plan: _Plan, xyz: list[Ints], rings: Ints, there: Indices
    ) -> tuple[_Plan, _Aim | None]:
        """Fit the rays of a spinning sensor to the points of a cloud.

        Parameters
        ----------
        plan
            The plan so far.
        xyz, rings
            Columns of the coordinates and of the rings, as sorted integers, (n,).
        there
            Indices of the points that are not missing, (m,).

        Returns
        -------
        plan
            The plan with the rays; an empty one if the points are on no rays.
        aim
            Azimuths and ranges of the points on the rays, or None.
        """
        axes, rings = [singles(axis[there]) for axis in xyz], rings[there]
        is_good = len(there) and rings.min() >= 0 and rings.max() < RINGS
        if not is_good or not all(np.isfinite(axis).all() and np.ptp(axis) for axis in axes):
            return _Plan(()), None
        points = np.stack(axes, axis=1).astype(np.float64)
        old = self._state.rays or self._first_rays
        located = None if old is None else old.located(points, rings)
        has_old_rays = located is not None and self._state.rays is not None
        located = located or fitted_rays(points, rings)
        if located is None or not located.rays.is_storable:
            return _Plan(()), None
        azimuths = np.zeros(len(xyz[0]), np.int64)
        azimuths[there] = located.azimuths
        plan = replace(plan, rays=located.rays, has_old_rays=has_old_rays)
        return plan, _Aim(azimuths, located.ranges)

    def _packed(self, plan: _Plan) -> bytes:
        columns = b"".join(column.packed() for column in plan.columns)
        if plan.rays is None:
            return bytes([0]) + columns
        flags = _HAS_RAYS | plan.has_old_rays * _HAS_OLD_RAYS | plan.has_missing * _HAS_MISSING
        rays = plan.rays.packed_phase() if plan.has_old_rays else plan.rays.packed()
        return bytes([flags]) + columns + b"".join(map(base_128, plan.missing)) + rays

    def _unpacked(self, reader: Reader) -> _Plan:
        flags = reader.take(1)[0]
        columns = tuple(ColumnPlan.unpacked(reader, each) for each in self._layout.columns)
        ways = [column.way for column in columns]
        on_rays = [k for k, way in enumerate(ways) if way == Way.RAY]
        if not flags & _HAS_RAYS:
            check(not on_rays and Way.RANGE not in ways and not reader.rest())
            return _Plan(columns)
        axes = self._axes
        check(axes is not None and on_rays == sorted(axes.xyz) and ways[axes.ring] != Way.RANGE)
        missing = reader.number(), reader.number(), reader.number()
        has_old_rays, old = bool(flags & _HAS_OLD_RAYS), self._state.rays
        check(old is not None or not has_old_rays)
        rays = old.with_phase(reader) if old and has_old_rays else Rays.unpacked(reader)
        check(not reader.rest())
        return _Plan(columns, rays, has_old_rays, bool(flags & _HAS_MISSING), missing)

    def _code(
        self, plan: _Plan, values: list[Ints], width: int, parts: Parts, aim: _Aim | None
    ) -> None:
        """Code the columns `values`, which a decoder writes; `aim` is what an encoder knows."""
        count, state, axes = len(values[0]), self._state, self._axes
        self._pass_stored(plan, values, parts)
        rings = np.zeros(count, np.int32)
        first = [] if axes is None else [axes.ring]
        for k in [*first, *(k for k in range(len(values)) if k not in first)]:
            if plan.columns[k].way == Way.SERIES:
                self._code_series(f"{k}", values[k], rings, width, self._bits(k), parts)
            if k in first:
                rings = (values[k] & RINGS - 1).astype(np.int32)
        if plan.rays is None or axes is None:
            there, ranges = np.arange(count), np.zeros(count, np.int64)
            near, seen = self._plain_neighbours(count)
        else:
            xyz = [values[k] for k in axes.xyz]
            azimuths = self._code_azimuths(plan, plan.rays, xyz, rings, width, parts, aim)
            there = np.flatnonzero(azimuths >= 0)
            on_rings, around = rings[there], azimuths[there]
            near, seen = self._neighbours(plan.rays, on_rings, around)
            ranges = self._code_ranges(near, on_rings, parts, aim)
            found = self._code_points(
                plan.rays, [axis[there] for axis in xyz], on_rings, around, ranges, parts
            )
            for axis, numbers, missing in zip(xyz, found, plan.missing, strict=True):
                axis[:] = missing
                axis[there] = numbers
        is_other = np.ones(count, bool)
        is_other[there] = False
        others = np.flatnonzero(is_other)
        for k, one in enumerate(plan.columns):
            if one.way == Way.RANGE:
                values[k][there] = ranges * one.farthest + one.start
            elif one.way == Way.VALUES:
                values[k][there] = self._code_values(
                    k, one, values[k][there], rings[there], near, parts
                )
            if one.way in (Way.RANGE, Way.VALUES) and len(others):
                rest = values[k][others]
                self._code_series(f"others {k}", rest, rings[others], 0, self._bits(k), parts)
                values[k][others] = rest
        state.rings, state.rays = seen, plan.rays

    def _pass_stored(self, plan: _Plan, values: list[Ints], parts: Parts) -> None:
        """Pass columns as compressed bytes, the lowest bytes of all values of a column first."""
        ways = [one.way for one in plan.columns]
        if Way.STORED not in ways:
            return
        count = len(values[0])
        columns = [
            (numbers, column.size)
            for way, numbers, column in zip(ways, values, self._layout.columns, strict=True)
            if way == Way.STORED
        ]
        if isinstance(parts, PartWriter):
            words = (
                numbers.astype("<i8").view(np.uint8).reshape(count, 8)[:, :size]
                for numbers, size in columns
            )
            parts.pass_bytes(compress_bytes(b"".join(each.T.tobytes() for each in words)))
            return
        most = count * sum(size for _, size in columns)
        part = Reader(parts.pass_bytes(b""))
        planes = Reader(decompress_bytes(part, lambda found: check(found == most)))
        for numbers, size in columns:
            bits = np.zeros((count, 8), np.uint8)
            bits[:, :size] = np.frombuffer(planes.take(count * size), np.uint8).reshape(size, -1).T
            numbers[:] = bits.view("<i8")[:, 0]

    def _bits(self, column: int) -> int:
        return 8 * self._layout.columns[column].size

    def _code_part(
        self, name: str, new: Callable[[BitCoder], Any], most_decisions: int, parts: Parts,
        code: Callable[..., bool], *arguments: Any,
    ) -> None:  # fmt: skip
        bits, state = parts.open(most_decisions), self._state
        model = state.models.pop(name, None)
        state.models[name] = model = with_coder(model, bits) if model else new(bits)
        if len(state.models) > _MOST_MODELS:
            oldest = next(iter(state.models))
            for kept in (state.models, state.series, state.values):
                kept.pop(oldest, None)
        parts.close(bits, code(model, *arguments))

    def _new_series(self, bits: BitCoder) -> SeriesModel:
        return new_series_model(bits, self._effort == "fast")

    def _new_values(self, bits: BitCoder) -> ValueModel:
        return new_value_model(bits, self._effort)

    def _code_series(
        self, name: str, values: Ints, rings: Words, width: int, bits: int, parts: Parts,
        skips: NDArray[np.bool_] | None = None,
    ) -> None:  # fmt: skip
        count, state, name = len(values), self._state, f"series {name}"
        self._code_part(
            name, self._new_series, (2 * bits + 4) * count, parts, code_series,
            values, rings, state.series.get(name, np.zeros(0, np.int64)),
            np.zeros(count, bool) if skips is None else skips, width, bits,
            np.zeros(PREDICTIONS, np.int64), np.zeros(count, np.int64),
            np.zeros((2, RINGS), np.int32), np.full(FOLLOWERS, -1, np.int32),
        )  # fmt: skip
        state.series[name] = values

    def _code_azimuths(
        self, plan: _Plan, rays: Rays, xyz: list[Ints], rings: Words, width: int, parts: Parts,
        aim: _Aim | None,
    ) -> Ints:  # fmt: skip
        """Return the azimuths (n,) of all points, -1 for missing ones."""
        count = len(rings)
        is_missing = np.zeros(count, np.int64)
        if plan.has_missing:
            if aim is not None:
                is_missing[:] = _equals(plan.missing, *xyz)
            self._code_series("missing", is_missing, rings, width, 1, parts)
        azimuths = np.zeros(count, np.int64) if aim is None else aim.azimuths
        skips = is_missing > 0
        self._code_series("azimuths", azimuths, rings, width, _AZIMUTH_BITS, parts, skips)
        found = np.where(skips, -1, azimuths)
        check(int(found.max()) < rays.count)
        check(int(rings[~skips].max(initial=0)) < len(rays.lines))
        return found

    def _neighbours(self, rays: Rays, rings: Words, azimuths: Ints) -> tuple[Words, Rings]:
        then = self._state
        now = rings_of(rings, azimuths, rays.count, len(rays.lines))
        has_then = then.rays is not None and then.rays.count == rays.count
        return neighbours_of(now, rings, then.rings if has_then else None, rays.count), now

    def _plain_neighbours(self, count: int) -> tuple[Words, Rings]:
        """Return neighbours of points without rays, by their places in this cloud and the last."""
        rings = np.zeros(count, np.int32)
        now = rings_of(rings, np.arange(count), _PLAIN_STEPS, 1)
        then = self._state.rings if self._state.rays is None else None
        return neighbours_of(now, rings, then, _PLAIN_STEPS), now

    def _code_ranges(self, near: Words, rings: Words, parts: Parts, aim: _Aim | None) -> Ints:
        column = blank_column(len(rings))
        if aim is not None:
            column.values[:-1] = aim.ranges + 1
        self._code_column(_RANGES, column, near, rings, _MOST_RANGE, parts)
        return column.values[:-1].astype(np.int64) - 1

    def _code_column(
        self, k: int, column: ValueColumn, near: Words, rings: Words, farthest: int, parts: Parts
    ) -> None:
        name = f"values {k}"
        before = self._state.values.get(name)
        if before is None or int(near[:, THEN:].max(initial=0)) >= len(before.values):
            before, near = blank_column(0), near.copy()
            near[:, THEN:] = 0
        self._code_part(
            name, self._new_values, _VALUE_DECISIONS * len(rings), parts, code_values,
            column, before, near, rings, farthest, k == _RANGES,
        )  # fmt: skip
        self._state.values[name] = column

    def _code_points(
        self, rays: Rays, actual: list[Ints], rings: Words, azimuths: Ints, ranges: Ints,
        parts: Parts,
    ) -> list[Ints]:  # fmt: skip
        """Code the sorted bits of x, y and z (n,) by their errors, and return them."""

        def code(name: str, bits: Ints, guess: Floats) -> Ints:
            return self._code_residuals(name, bits, guess.astype(np.float32), rings, parts)

        guess = rays.predicted(rings, azimuths, ranges.astype(np.float64))
        if rays.is_exact:
            triples = zip("xyz", actual, guess, strict=True)
            return [code(name, bits, floats) for name, bits, floats in triples]
        if not rays.is_stepped:
            x, y = code("x", actual[0], guess[0]), code("y", actual[1], guess[1])
            refined = rays.from_level(rings, singles(x), singles(y))
            return [x, y, code("z", actual[2], rays.heights(rings, refined))]
        is_x = np.abs(guess[0]) >= np.abs(guess[1])
        larger = code("larger", np.where(is_x, *actual[:2]), np.where(is_x, *guess[:2]))
        refined = rays.refined(rings, azimuths, singles(larger), is_x)
        guess = rays.predicted(rings, azimuths, refined)
        smaller = code("smaller", np.where(~is_x, *actual[:2]), np.where(~is_x, *guess[:2]))
        z = code("z", actual[2], guess[2])
        return [np.where(is_x, larger, smaller), np.where(is_x, smaller, larger), z]

    def _code_residuals(
        self, name: str, actual: Ints, guess: Singles, rings: Words, parts: Parts
    ) -> Ints:
        base = sorted_bits(guess)
        residuals = actual - base
        self._code_part(
            f"residuals {name}", self._new_series, (2 * _RESIDUAL_BITS + 4) * len(base), parts,
            code_residuals, residuals, rings, _octaves(guess), np.zeros(RINGS, np.int64),
        )  # fmt: skip
        return base + residuals & 0xFFFFFFFF

    def _code_values(
        self, k: int, plan: ColumnPlan, values: Ints, rings: Words, near: Words, parts: Parts
    ) -> Ints:
        column = blank_column(len(values))
        split = SplitColumn(np.zeros(0, np.int64), b"", b"")
        if isinstance(parts, PartWriter):
            split = split_column(plan, values)
            column.values[:-1] = split.numbers
        self._code_column(k, column, near, rings, plan.farthest, parts)
        numbers = column.values[:-1].astype(np.int64)
        low, listed = parts.pass_bytes(split.low), parts.pass_bytes(split.listed)
        if isinstance(parts, PartWriter):
            return values
        return join_column(plan, SplitColumn(numbers, low, listed))


def _axes(layout: CloudLayout) -> _Axes | None:
    """Return the columns of coordinates and rings, if a layout has them."""
    names = [column.name for column in layout.columns]
    rings = [names.index(name) for name in RING_NAMES if names.count(name) == 1]
    if not rings or any(names.count(axis) != 1 for axis in "xyz"):
        return None
    x, y, z = map(names.index, "xyz")
    are_single = all(layout.columns[k].datatype == FLOAT32 for k in (x, y, z))
    is_whole = layout.columns[rings[0]].datatype < FLOAT32
    return _Axes(x, y, z, rings[0]) if are_single and is_whole else None


def _count_values(plan: _Plan, count: int) -> int:
    return count * sum(column.way != Way.CONSTANT for column in plan.columns)


def _missing(x: Ints, y: Ints, z: Ints) -> tuple[tuple[int, int, int], NDArray[np.bool_]]:
    """Return the bits of the first point without coordinates, and which points equal it."""
    floats = np.stack([singles(axis) for axis in (x, y, z)])
    is_odd = ~np.isfinite(floats[0]) | (floats == 0).all(axis=0)
    if not is_odd.any():
        return (0, 0, 0), is_odd
    first = int(np.argmax(is_odd))
    bits = int(x[first]), int(y[first]), int(z[first])
    return bits, _equals(bits, x, y, z)


def _equals(bits: tuple[int, int, int], *xyz: Ints) -> NDArray[np.bool_]:
    x, y, z = (axis == number for axis, number in zip(xyz, bits, strict=True))
    return np.asarray(x & y & z)


def _octaves(guess: Singles) -> Bytes:
    """Return the octave of each number, 0 to 63, as a context of its error."""
    _, exponents = np.frexp(np.where(np.isfinite(guess), guess, 0))
    return (exponents + 40).clip(0, 63).astype(np.uint8)
