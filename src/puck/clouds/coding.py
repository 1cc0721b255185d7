"""Coding of the columns of a cloud's points, in the same steps for encoding and decoding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.context_mixing import Ints, Words
from puck.clouds.layout import FLOAT32, Bytes, CloudLayout, Column, Values, from_sorted, to_sorted
from puck.clouds.neighbours import Rings, neighbours_of, rings_of
from puck.clouds.rays import Rays, fitted_rays
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

_CONSTANT, _SERIES, _VALUES, _RAY, _RANGE = range(5)
_RING_NAMES = ("ring", "channel", "laser_id", "line", "laser")
_TIME_NAMES = ("t", "time", "timestamp", "time_stamp", "offset_time", "time_offset")
_SCALES = (0, 1, 10, 100, 1000, 10000, 255, 256, 1000000)
"""Factors by which a column of floats may become integers; 0 for the bits of the floats."""
_MOST_WHOLE = 1e6
_MOST_ODD = 0.02
"""Share of floats that may not be integers in a column's unit; they are listed."""
_SAMPLE = 200
"""Number of floats that are tried first."""
_MOST_VALUE = 1 << 23
_FEWEST_POINTS = 64
_UNSTRUCTURED = 1 << 40


class ColumnPlan(NamedTuple):
    """How a column is coded: the way, and its numbers."""

    way: int
    scale: int = 0  # index of `_SCALES`
    shift: int = 0  # number of low bits that are stored uncoded
    lowest: int = 0  # value that is subtracted, or the constant
    farthest: int = 0  # greatest coded value

    def packed(self) -> bytes:
        """Return the bytes that `unpacked` reads."""
        return bytes([self.way, self.scale, self.shift]) + b"".join(
            base_128(number) for number in (self.lowest, self.farthest)
        )

    @classmethod
    def unpacked(cls, reader: Reader) -> ColumnPlan:
        """Read what `packed` wrote."""
        way, scale, shift = reader.take(3)
        check(way <= _RANGE and scale < len(_SCALES) and shift < 64)
        lowest, farthest = reader.number(10), reader.number()
        check(lowest < 1 << 64 and farthest <= _MOST_VALUE)
        return cls(way, scale, shift, lowest, farthest)


@dataclass(frozen=True)
class CloudPlan:
    """How a cloud is coded: its columns, and how points follow from rays."""

    columns: tuple[ColumnPlan, ...]
    rays: Rays | None
    is_same_rays: bool
    missing: tuple[int, int, int]  # sorted bits of x, y and z of a missing point
    has_missing: bool


@dataclass
class _State:
    """Models, and what of the cloud before predicts the next one."""

    effort: Effort
    models: dict[str, Any] = field(default_factory=dict)
    series: dict[int, Ints] = field(default_factory=dict)
    values: dict[int, ValueColumn] = field(default_factory=dict)
    rings: Rings | None = None
    rays: Rays | None = None


def geometry_columns(layout: CloudLayout) -> tuple[int, int, int, int] | None:
    """Return the indices of the columns x, y, z and ring, if a layout has them."""
    names = [column.name for column in layout.columns]
    rings = [names.index(name) for name in _RING_NAMES if names.count(name) == 1]
    if not rings or any(names.count(name) != 1 for name in "xyz"):
        return None
    x, y, z = map(names.index, "xyz")
    are_single = all(layout.columns[k].datatype == FLOAT32 for k in (x, y, z))
    is_whole = layout.columns[rings[0]].datatype < FLOAT32
    return (x, y, z, rings[0]) if are_single and is_whole else None


def singles(values: Ints) -> NDArray[np.float32]:
    """Return the floats whose sorted bits are given."""
    return from_sorted(values.astype(np.uint32), FLOAT32).view(np.float32)


def sorted_bits(floats: NDArray[np.float32]) -> Ints:
    """Return the sorted bits of floats."""
    return to_sorted(np.ascontiguousarray(floats).view(np.uint32), FLOAT32).astype(np.int64)


class PointCoder:
    """Encoder or decoder of the points of successive clouds of one layout."""

    def __init__(self, layout: CloudLayout, effort: Effort) -> None:
        self.layout, self.state = layout, _State(effort)
        self.geometry = geometry_columns(layout)

    # --- encoding -----------------------------------------------------------------------------

    def encode(self, points: Bytes, width: int) -> bytes:
        """Return bytes from which `decode` restores points (n, point_step).

        The argument `width` is the number of points in a row of an organised cloud, or 0.
        """
        layout = self.layout
        table = [layout.values(points, column) for column in layout.columns]
        arrays: list[Ints] = [values.astype(np.int64) for values in table]
        plan, geometry = self._plan(table, arrays, width)
        writer = PartWriter()
        head = self._packed(plan)
        self._code(plan, arrays, width, writer, geometry)
        return base_128(len(head)) + head + writer.joined()

    def _plan(
        self, table: list[Values], arrays: list[Ints], width: int
    ) -> tuple[CloudPlan, tuple[Ints, Ints] | None]:
        rays, geometry, missing, has_missing, is_same = None, None, (0, 0, 0), False, False
        columns: list[ColumnPlan | None] = [None] * len(arrays)
        count = len(arrays[0])
        for k, array in enumerate(arrays):
            if (array == array[0]).all():
                columns[k] = ColumnPlan(_CONSTANT, lowest=int(table[k][0]))
        if self.geometry is not None and count >= _FEWEST_POINTS:
            x, y, z, ring = self.geometry
            rings = arrays[ring]
            if all(columns[k] is None for k in (x, y, z)) and 0 <= rings.min() and rings.max() < RINGS:
                missing, is_missing = _missing(arrays[x], arrays[y], arrays[z])
                has_missing = bool(is_missing.any())
                there = np.flatnonzero(~is_missing)
                xyz = np.stack([singles(arrays[k][there]) for k in (x, y, z)], axis=1)
                located = None
                if np.isfinite(xyz).all():
                    wide, those = xyz.astype(np.float64), rings[there]
                    if self.state.rays is not None:
                        located = self.state.rays.located(wide, those)
                    is_same = located is not None
                    located = located or fitted_rays(wide, those)
                if located is not None:
                    rays = located.rays
                    whole = np.zeros(count, np.int64)
                    whole[there] = located.azimuths
                    geometry = whole, located.ranges
                    for k in (x, y, z):
                        columns[k] = ColumnPlan(_RAY)
                else:
                    has_missing = False
        for k, column in enumerate(columns):
            if column is None:
                columns[k] = self._column_plan(k, table[k], arrays[k], width)
                if geometry is not None and len(there):
                    columns[k] = _range_plan(arrays[k][there], geometry[1]) or columns[k]
        chosen = tuple(column for column in columns if column is not None)
        return CloudPlan(chosen, rays, is_same, missing, has_missing), geometry

    def _column_plan(self, k: int, values: Values, array: Ints, width: int) -> ColumnPlan:
        column = self.layout.columns[k]
        if column.name.lower() in _RING_NAMES + _TIME_NAMES or _is_regular(array, width):
            return ColumnPlan(_SERIES)
        scale, whole = 0, array
        if column.datatype == FLOAT32:
            scale, whole = _scaled(singles(array), array)
        source = whole if scale else values
        lowest, greatest = int(source.min()), int(source.max())
        span = greatest - lowest
        steps = np.abs(np.diff(whole))
        if not len(steps):
            return ColumnPlan(_SERIES)
        shift = max(int(np.median(steps)).bit_length() - 6, 0)
        if span >= 1 << 62 or span >> shift >= _MOST_VALUE - 2:
            return ColumnPlan(_SERIES)
        return ColumnPlan(_VALUES, scale, shift, lowest % (1 << 64), (span >> shift) + 1)

    def _packed(self, plan: CloudPlan) -> bytes:
        flags = (plan.rays is not None) | plan.is_same_rays << 1 | plan.has_missing << 2
        head = bytes([flags]) + b"".join(column.packed() for column in plan.columns)
        if plan.rays is not None:
            head += b"".join(map(base_128, plan.missing))
            head += plan.rays.packed_phase() if plan.is_same_rays else plan.rays.packed()
        return head

    # --- decoding -----------------------------------------------------------------------------

    def decode(self, reader: Reader, count: int, width: int) -> Bytes:
        """Return points (count, point_step) that `encode` encoded; raise InputError if damaged."""
        layout = self.layout
        plan = self._unpacked(Reader(reader.take(reader.number())))
        arrays = [np.zeros(count, np.int64) for _ in layout.columns]
        self._code(plan, arrays, width, PartReader(reader), None)
        points = np.zeros((count, layout.point_step), np.uint8)
        for column, array in zip(layout.columns, arrays, strict=True):
            layout.put(points, column, array.astype(f"u{column.size}"))
        return points

    def _unpacked(self, reader: Reader) -> CloudPlan:
        flags = reader.take(1)[0]
        columns = tuple(ColumnPlan.unpacked(reader) for _ in self.layout.columns)
        rays, missing = None, (0, 0, 0)
        are_rays = {k for k, plan in enumerate(columns) if plan.way == _RAY}
        check(are_rays == (set(self.geometry[:3]) if flags & 1 and self.geometry else set()))
        check(bool(flags & 1) or all(plan.way != _RANGE for plan in columns))
        if flags & 1:
            x, y, z = reader.number(), reader.number(), reader.number()
            missing = x, y, z
            if flags & 2:
                check(self.state.rays is not None)
                rays = self.state.rays.with_phase(reader)
            else:
                rays = Rays.unpacked(reader)
        check(not reader.rest())
        for column, plan in zip(self.layout.columns, columns, strict=True):
            check(plan.scale == 0 or column.datatype == FLOAT32)
        return CloudPlan(columns, rays, bool(flags & 2), missing, bool(flags & 4))

    # --- both ---------------------------------------------------------------------------------

    def _code(
        self, plan: CloudPlan, arrays: list[Ints], width: int, parts: Parts,
        geometry: tuple[Ints, Ints] | None,
    ) -> None:  # fmt: skip
        count, state = len(arrays[0]), self.state
        rings = np.zeros(count, np.int32)
        order = list(range(len(arrays)))
        if self.geometry is not None:
            order.insert(0, order.pop(self.geometry[3]))
        ring_column = order[0] if self.geometry is not None else None
        columns = self.layout.columns
        for k in order:
            one, bits = plan.columns[k], 8 * columns[k].size
            if one.way == _CONSTANT:
                arrays[k][:] = _as_signed(one.lowest)
            elif one.way == _SERIES:
                self._code_series(f"{k}", arrays[k], rings, width, bits, parts)
            if k == ring_column:
                rings = (arrays[k] & (RINGS - 1)).astype(np.int32)
        there: NDArray[np.intp] | None = None
        if plan.rays is not None and self.geometry is not None:
            there, around = self._code_rays(plan, arrays, rings, width, parts, geometry)
            near, seen, ranges = self._neighbours(rings[there], around, plan.rays.count, parts, geometry, plan, arrays, there)
        else:
            there = np.arange(count)
            near, seen = self._plain_neighbours(count)
            ranges = np.zeros(count, np.int64)
        is_there = np.zeros(count, bool)
        is_there[there] = True
        others = np.flatnonzero(~is_there)
        for k, one in enumerate(plan.columns):
            if one.way == _VALUES:
                self._code_values(k, one, arrays[k], there, rings, near, parts)
            elif one.way == _RANGE:
                arrays[k][there] = ranges * one.farthest + _as_signed(one.lowest)
            if one.way in (_VALUES, _RANGE) and len(others):
                rest = arrays[k][others]
                self._code_series(f"others {k}", rest, rings[others], 0, 8 * columns[k].size, parts)
                arrays[k][others] = rest
        state.rings, state.rays = seen, plan.rays

    def _code_part(
        self, parts: Parts, name: str, new: Callable[..., Any], most: int,
        code: Callable[..., bool], *arguments: Any,
    ) -> None:  # fmt: skip
        bits = parts.open(most)
        model = self.state.models.get(name)
        model = new(bits) if model is None else with_coder(model, bits)
        self.state.models[name] = model
        parts.close(bits, code(model, *arguments))

    def _new_series(self, bits: Any) -> SeriesModel:
        return new_series_model(bits, self.state.effort == "fast")

    def _new_values(self, bits: Any) -> ValueModel:
        return new_value_model(bits, self.state.effort)

    def _code_series(
        self, name: str, values: Ints, rings: Words, width: int, bits: int, parts: Parts,
        skips: NDArray[np.bool_] | None = None, extra: Bytes | None = None,
    ) -> None:  # fmt: skip
        count = len(values)
        before = self.state.series.get(name, np.zeros(0, np.int64))
        self._code_part(
            parts, f"series {name}", self._new_series, (2 * bits + 4) * count, code_series, values, rings,
            np.zeros(count, np.uint8) if extra is None else extra, before,
            np.zeros(count, bool) if skips is None else skips, width, bits,
            np.zeros(PREDICTIONS, np.int64), np.zeros(count, np.int64), np.zeros((2, RINGS), np.int32),
            np.full(FOLLOWERS, -1, np.int32),
        )  # fmt: skip
        self.state.series[name] = values

    def _code_residuals(
        self, name: str, values: Ints, rings: Words, extra: Bytes, parts: Parts
    ) -> None:
        self._code_part(
            parts, f"residuals {name}", self._new_series, 132 * len(values), code_residuals, values, rings,
            extra, np.zeros(RINGS, np.int64),
        )  # fmt: skip

    def _code_rays(
        self, plan: CloudPlan, arrays: list[Ints], rings: Words, width: int, parts: Parts,
        geometry: tuple[Ints, Ints] | None,
    ) -> tuple[NDArray[np.intp], Ints]:  # fmt: skip
        assert plan.rays is not None and self.geometry is not None
        x = self.geometry[0]
        count = len(arrays[0])
        is_missing = np.zeros(count, np.int64)
        if plan.has_missing:
            if geometry is not None:
                is_missing = _is_missing(plan.missing, *(arrays[k] for k in self.geometry[:3])).astype(np.int64)
            self._code_series("missing", is_missing, rings, width, 2, parts)
        check(bool((is_missing < 2).all()) and int(rings.max(initial=0)) < len(plan.rays.lines))
        azimuths = np.zeros(count, np.int64) if geometry is None else geometry[0]
        skips = is_missing > 0
        self._code_series("azimuths", azimuths, rings, width, 17, parts, skips)
        there = np.flatnonzero(~skips)
        around = azimuths[there]
        check(bool((around < plan.rays.count).all() and (around >= 0).all()))
        return there, around

    def _neighbours(self, rings, around, steps, parts, geometry, plan, arrays, there):
        state = self.state
        count = len(plan.rays.lines)
        now = rings_of(rings, around, steps, count)
        then = state.rings if state.rays is not None and state.rays.count == steps else None
        near = neighbours_of(now, rings, then, steps)
        ranges = blank_column(len(rings))
        if geometry is not None:
            ranges.values[:-1] = geometry[1] + 1
        farthest = 1 << 24
        before = state.values.get(-1, blank_column(0)) if then is not None else blank_column(0)
        if then is None:
            near[:, 8:] = 0
        self._code_part(
            parts, "ranges", self._new_values, 80 * len(rings), code_values, ranges, before, near, rings,
            farthest, True,
        )  # fmt: skip
        state.values[-1] = ranges
        self._code_points(plan.rays, arrays, there, rings, around, ranges.values[:-1] - 1.0, parts, geometry is not None, plan)
        return near, now, ranges.values[:-1].astype(np.int64) - 1

    def _plain_neighbours(self, count: int) -> tuple[Words, Rings | None]:
        rings, index = np.zeros(count, np.int32), np.arange(count)
        now = rings_of(rings, index, _UNSTRUCTURED, 1)
        then = self.state.rings if self.state.rays is None else None
        near = neighbours_of(now, rings, then, _UNSTRUCTURED)
        if then is None:
            near[:, 8:] = 0
        return near, now

    def _code_points(self, rays, arrays, there, rings, around, ranges, parts, is_encoding, plan):
        x, y, z = self.geometry[:3]
        actual = [arrays[k][there] for k in (x, y, z)]
        guess = rays.predicted(rings, around, ranges)
        guess = [part.astype(np.float32) for part in guess]

        def code(name: str, actual: Ints, guess: Any, rows: Any = slice(None)) -> Ints:
            base = sorted_bits(guess)
            residuals = actual - base
            extra = _scale_context(guess)
            self._code_residuals(name, residuals, rings[rows], extra, parts)
            return base + residuals & 0xFFFFFFFF

        if rays.is_exact:
            found = [code(name, a, g) for name, a, g in zip("xyz", actual, guess, strict=True)]
        elif rays.is_stepped:
            is_x = np.abs(guess[0]) >= np.abs(guess[1])
            first = code("first", np.where(is_x, actual[0], actual[1]), np.where(is_x, guess[0], guess[1]))
            ranges = rays.refined(rings, around, singles(first), is_x)
            guess = [part.astype(np.float32) for part in rays.predicted(rings, around, ranges)]
            second = code("second", np.where(is_x, actual[1], actual[0]), np.where(is_x, guess[1], guess[0]))
            third = code("z", actual[2], guess[2])
            found = [np.where(is_x, first, second), np.where(is_x, second, first), third]
        else:
            found = [code(name, a, g) for name, a, g in zip("xy", actual[:2], guess[:2], strict=True)]
            ranges = rays.from_level(rings, singles(found[0]), singles(found[1]))
            found.append(code("z", actual[2], rays.heights(rings, ranges).astype(np.float32)))
        if not is_encoding:
            for k, part, filler in zip((x, y, z), found, plan.missing, strict=True):
                arrays[k][:] = filler
                arrays[k][there] = part

    def _code_values(
        self, k: int, plan: ColumnPlan, array: Ints, there: Any, rings: Words, near: Words,
        parts: Parts,
    ) -> None:  # fmt: skip
        lowest = _as_signed(plan.lowest)
        low, listed = np.zeros(0, np.int64), b""
        column = blank_column(len(there))
        is_encoding = isinstance(parts, PartWriter)
        if is_encoding:
            whole = array[there]
            if plan.scale:
                bits = whole
                whole, odd = _whole(singles(bits), bits, plan.scale)
                listed = _listed(bits, odd)
            above = whole - lowest
            column.values[:-1] = (above >> plan.shift) + 1
            low = above & (1 << plan.shift) - 1
        before = self.state.values.get(k, blank_column(0))
        if len(before.values) == 1 and len(near):
            near = near.copy()
            near[:, 8:] = 0
        elif len(near) and int(near[:, 8:].max()) >= len(before.values):
            near = near.copy()
            near[:, 8:] = len(before.values) - 1
        self._code_part(
            parts, f"values {k}", self._new_values, 80 * len(there), code_values, column, before, near,
            rings[there], plan.farthest, False,
        )  # fmt: skip
        self.state.values[k] = column
        if plan.shift:
            packed = parts.pass_bytes(_packed_bits(low, plan.shift) if is_encoding else b"")
            if not is_encoding:
                low = _unpacked_bits(packed, len(there), plan.shift)
        if plan.scale:
            listed = parts.pass_bytes(listed)
        if not is_encoding:
            whole = (column.values[:-1].astype(np.int64) - 1 << plan.shift) + lowest
            if plan.shift:
                whole += low
            if plan.scale:
                whole = _scaled_back(whole, plan.scale)
                _write_listed(whole, listed)
            array[there] = whole


def _as_signed(number: int) -> np.int64:
    return np.uint64(number).astype(np.int64)


def _range_plan(values: Ints, ranges: Ints) -> ColumnPlan | None:
    """Return the plan of a column that follows from the ranges, or None if it does not."""
    spread = int(np.argmax(ranges))
    apart = int(ranges[spread] - ranges[0])
    factor = int(values[spread] - values[0]) // apart if apart else 0
    lowest = int(values[0]) - factor * int(ranges[0])
    if 0 < factor <= _MOST_VALUE and (values == ranges * factor + lowest).all():
        return ColumnPlan(_RANGE, lowest=lowest % (1 << 64), farthest=factor)
    return None


def _missing(x: Ints, y: Ints, z: Ints) -> tuple[tuple[int, int, int], NDArray[np.bool_]]:
    """Return the bits of missing points, and which points are missing."""
    floats = [singles(values) for values in (x, y, z)]
    odd = ~np.isfinite(floats[0]) | ((floats[0] == 0) & (floats[1] == 0) & (floats[2] == 0))
    places = np.flatnonzero(odd)
    if not len(places):
        return (0, 0, 0), odd
    first = places[0]
    bits = int(x[first]), int(y[first]), int(z[first])
    return bits, _is_missing(bits, x, y, z)


def _is_missing(bits: tuple[int, int, int], x: Ints, y: Ints, z: Ints) -> NDArray[np.bool_]:
    return (x == bits[0]) & (y == bits[1]) & (z == bits[2])


def _scaled(floats: NDArray[np.float32], bits: Ints) -> tuple[int, Ints]:
    """Return the index of the scale by which floats are integers, and these; 0 for the bits."""
    few = slice(0, _SAMPLE)
    for k in range(1, len(_SCALES)):
        _, odd = _whole(floats[few], bits[few], k)
        if 2 * np.count_nonzero(odd) > len(odd):
            continue
        whole, odd = _whole(floats, bits, k)
        if np.count_nonzero(odd) <= _MOST_ODD * len(bits):
            return k, whole
    return 0, bits


def _whole(floats: NDArray[np.float32], bits: Ints, scale: int) -> tuple[Ints, NDArray[np.bool_]]:
    """Return floats as integers, and which floats are not restored from them."""
    is_usual = np.abs(floats) < _MOST_WHOLE
    whole = np.rint(np.where(is_usual, floats, 0).astype(np.float64) * _SCALES[scale])
    numbers = whole.astype(np.int64)
    return numbers, _scaled_back(numbers, scale) != bits


def _scaled_back(whole: Ints, scale: int) -> Ints:
    return sorted_bits((whole / _SCALES[scale]).astype(np.float32))


def _listed(bits: Ints, odd: NDArray[np.bool_]) -> bytes:
    """Return the places and values of odd numbers, compressed, or no bytes if there are none."""
    places = np.flatnonzero(odd)
    pairs = np.stack([np.diff(places, prepend=0), bits[places]]).astype("<u4")
    return compress_bytes(pairs.tobytes()) if len(places) else b""


def _write_listed(bits: Ints, listed: bytes) -> None:
    """Write the numbers of `_listed` to their places."""
    if listed:
        most = 8 * len(bits)
        raw = decompress_bytes(Reader(listed), lambda size: check(size <= most and size % 8 == 0))
        steps, values = np.frombuffer(raw, "<u4").reshape(2, -1).astype(np.int64)
        places = np.cumsum(steps)
        check(not len(places) or int(places[-1]) < len(bits))
        bits[places] = values


def _is_regular(values: Ints, width: int) -> bool:
    """Return whether most values follow exactly from earlier ones."""
    steps = np.diff(values)
    hits = [np.count_nonzero(steps == 0), np.count_nonzero(np.diff(steps) == 0)]
    if 0 < width < len(values):
        hits.append(np.count_nonzero(values[width:] == values[:-width]))
    return 2 * max(hits) > len(values)


def _scale_context(guess: NDArray[np.float32]) -> Bytes:
    """Return the octave of each number, as a context of its error."""
    _, exponents = np.frexp(np.where(np.isfinite(guess), guess, 0))
    return (exponents + 40).clip(0, 63).astype(np.uint8)


def _packed_bits(numbers: Ints, width: int) -> bytes:
    bits = (numbers[:, None] >> np.arange(width)) & 1
    return np.packbits(bits.astype(np.uint8)).tobytes()


def _unpacked_bits(packed: bytes, count: int, width: int) -> Ints:
    check(len(packed) == -(-count * width // 8))
    bits = np.unpackbits(np.frombuffer(packed, np.uint8), count=count * width).reshape(count, width)
    return (bits.astype(np.int64) << np.arange(width)).sum(axis=1)
