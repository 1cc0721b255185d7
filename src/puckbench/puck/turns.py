"""Turns as bytes: azimuths, ranges, second returns, times and reflectivities, a part each.

A key turn can be decoded alone; any other one after its predecessor, whose models go on.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.binary_coder import (
    BitCoder,
    bit_reader,
    bit_writer,
    read_to_its_end,
    written,
)
from puckbench.coding.byte_io import Reader, base_128
from puckbench.core.errors import InputError
from puckbench.lidar.turns import CENTIDEGREES, Layout, Turn, check_turn
from puckbench.puck.mixing import Ints, Words
from puckbench.puck.options import EFFORTS, MAX_STEP, CodingOptions
from puckbench.puck.ranges import (
    MODEL_SIZES,
    PAD,
    Image,
    Model,
    code_ranges,
    new_model,
    with_bits,
)
from puckbench.puck.reflectivity import (
    ByteModel,
    Bytes,
    bytes_with_bits,
    code_reflectivities,
    new_byte_model,
)
from puckbench.puck.second_returns import (
    SecondModel,
    code_second,
    new_second_model,
    second_with_bits,
)
from puckbench.puck.sequences import Track, code_sequence, new_track, track_with_bits

_KEY, _TIMES, _REFLECTIVITIES = 1, 2, 4
_EFFORT = 3
"""Bits of a turn's flags below those of the effort."""
_LEAN = 32
"""Flag of reflectivities that are coded by few contexts."""
_CLOCK = 1 << 32
_NEAREST = 200
"""Farthest that a column of the turn before may be away, in 0.01 degrees."""
_FIRST_ERROR = 48
_BYTES_OF_A_DECISION = 2
"""Bytes that a decision may cost at most (a bit of probability 2**-11)."""


Values = NDArray[np.uint16] | NDArray[np.uint8]


@dataclass
class _State:
    """Models of the turns so far, and the last one."""

    layout: Layout
    step: int
    effort: int
    azimuths: Track
    ranges: Model
    second: SecondModel
    times: Track
    reflectivities: list[ByteModel]
    before: _Before | None = None


@dataclass
class _Before:
    """The last turn, as contexts of the next one."""

    azimuths: Ints
    image: Image
    kinds: list[Words]
    values: list[Words] = field(default_factory=list)
    held: list[Words] = field(default_factory=list)


def _new_state(layout: Layout, step: int, lmbda: float, effort: int) -> _State:
    bits, lasers = bit_writer(0), layout.lasers
    size = MODEL_SIZES[EFFORTS[effort]]
    whole = max(round(16 * lmbda), 1) if lmbda > 0 else 0
    return _State(
        layout, step, effort,
        new_track(bits, CENTIDEGREES),
        new_model(bits, lasers, size, step, whole),
        new_second_model(bits, lasers, step),
        new_track(bits, _CLOCK),
        [],
    )  # fmt: skip


class TurnEncoder:
    """Encodes turns one after the other."""

    def __init__(self, layout: Layout, options: CodingOptions | None = None) -> None:
        self.layout, self.options = layout, options or CodingOptions()
        self._state: _State | None = None
        self._since_key = 0

    def encode(self, turn: Turn) -> bytes:
        """Code a turn; InputError when it has not the layout's shapes."""
        check_turn(turn, self.layout)
        options = self.options
        effort = EFFORTS.index(options.effort)
        is_key = self._state is None or 0 < options.key_every <= self._since_key
        if self._state is None or is_key:
            self._state = _new_state(self.layout, options.step, options.lmbda, effort)
            self._since_key = 0
        self._since_key += 1
        flags = is_key * _KEY | effort << _EFFORT | (options.effort == "fast") * _LEAN
        flags |= (options.times and turn.times is not None) * _TIMES
        flags |= (options.reflectivities and turn.reflectivities is not None) * _REFLECTIVITIES
        coder = _PartWriter()
        _code_turn(self._state, _laid(turn, self.layout), flags, coder)
        head = bytes([flags]) + base_128(options.step) + base_128(len(turn.azimuths))
        return head + b"".join(base_128(len(part)) + part for part in coder.parts)


class TurnDecoder:
    """Decodes turns one after the other, from a key turn on."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._state: _State | None = None

    def decode(self, body: bytes) -> Turn:
        """The turn of `TurnEncoder.encode`.

        Raises
        ------
        InputError
            The bytes are damaged, or the turn before is missing.
        """
        reader = Reader(body)
        flags, step, blocks = reader.take(1)[0], reader.number(), reader.number()
        effort = flags >> _EFFORT & 3
        if (
            effort >= len(EFFORTS)
            or flags > 2 * _LEAN - 1
            or not 1 <= step <= MAX_STEP
            or not 1 <= blocks <= self.layout.max_blocks
        ):
            raise InputError("the stream is damaged (a turn's header)")
        if flags & _KEY:
            self._state = _new_state(self.layout, step, 0, effort)
        state = self._state
        if state is None or (step, effort) != (state.step, state.effort):
            raise InputError("the turn needs the turn before it")
        self._state = None  # until this one is whole
        now, times = _code_turn(state, _blank(blocks, self.layout), flags, _PartReader(reader))
        if reader.rest():
            raise InputError("the stream is damaged (a turn's length)")
        self._state = state
        return _decoded(self.layout, now, times)


def is_key(body: bytes) -> bool:
    """Return whether a coded turn can be decoded alone."""
    return bool(body[:1] and body[0] & _KEY)


def turn_step(body: bytes) -> int:
    """Return the step of a coded turn's ranges, in quanta."""
    reader = Reader(body)
    reader.take(1)
    return reader.number()


def _laid(turn: Turn, layout: Layout) -> Turn:
    """The turn with its lasers by elevation."""
    order = list(layout.order)
    told = turn.reflectivities
    return replace(
        turn,
        ranges=turn.ranges[..., order],
        reflectivities=None if told is None else told[..., order],
    )


def _blank(blocks: int, layout: Layout) -> Turn:
    shape = (layout.kinds, blocks * layout.columns_per_block, layout.lasers)
    packets = -(-blocks // layout.blocks_per_time)
    return Turn(
        np.zeros(shape, np.uint16),
        np.zeros(blocks, np.uint16),
        np.zeros(packets, np.uint32),
        np.zeros(shape, np.uint8),
    )


class _PartWriter:
    """Makes a coder for each part and keeps what it wrote."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []

    def open(self, most_decisions: int) -> BitCoder:
        return bit_writer(most_decisions * _BYTES_OF_A_DECISION + 64)

    def close(self, bits: BitCoder, is_whole: bool) -> None:
        del is_whole
        self.parts.append(written(bits))


class _PartReader:
    """Makes a coder of each part, and checks that it was read to its end."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def open(self, most_decisions: int) -> BitCoder:
        del most_decisions
        return bit_reader(self._reader.take(self._reader.number()))

    def close(self, bits: BitCoder, is_whole: bool) -> None:
        if not is_whole or not read_to_its_end(bits):
            raise InputError("the stream is damaged (a turn)")


def _code_turn(
    state: _State, turn: Turn, flags: int, parts: _PartWriter | _PartReader
) -> tuple[_Before, NDArray[np.uint32] | None]:
    """Code a turn's parts: a writer codes `turn`, a reader a turn of its shapes.

    Returns what the next turn needs of it, and its times.
    """
    azimuths = turn.azimuths.astype(np.int64)
    bits = parts.open(64 * len(azimuths))
    state.azimuths = track_with_bits(state.azimuths, bits)
    parts.close(bits, code_sequence(state.azimuths, azimuths))
    places = _places(state, azimuths)
    now = _code_kinds(state, azimuths, places, turn, parts)
    times = None
    if flags & _TIMES and turn.times is not None:
        numbers = turn.times.astype(np.int64)
        bits = parts.open(64 * len(numbers))
        state.times = track_with_bits(state.times, bits)
        parts.close(bits, code_sequence(state.times, numbers))
        times = numbers.astype(np.uint32)
    if flags & _REFLECTIVITIES and turn.reflectivities is not None:
        lean = bool(flags & _LEAN)
        _code_values(state, now, places, turn.reflectivities, parts, lean=lean)
    state.before = now
    return now, times


def _decoded(layout: Layout, now: _Before, times: NDArray[np.uint32] | None) -> Turn:
    """The turn that was decoded, its lasers in the order of packets."""
    order = np.argsort(layout.order)
    ranges = np.stack([kind[PAD:] for kind in now.kinds]).astype(np.uint16)
    values = None
    if now.values:
        values = np.stack([own[PAD:] for own in now.values]).astype(np.uint8).take(order, axis=2)
    return Turn(ranges.take(order, axis=2), now.azimuths.astype(np.uint16), times, values)


def _code_kinds(
    state: _State, azimuths: Ints, places: Ints, turn: Turn, parts: _PartWriter | _PartReader
) -> _Before:
    """Code the ranges."""
    layout = state.layout
    sources = [_padded(kind) for kind in turn.ranges]
    columns = len(sources[0]) - PAD
    before = state.before
    image = Image(*(np.zeros_like(sources[0]) for _ in range(4)))
    image.errors[:PAD] = _FIRST_ERROR
    then = Image(*(np.zeros((1, layout.lasers), np.int32) for _ in range(4)))
    if before is not None:
        for rows, earlier in zip(image, before.image, strict=True):
            rows[:PAD] = earlier[-PAD:]
        then = Image(*map(_extended, before.image))
    bits = parts.open(columns * layout.lasers * 48)
    state.ranges = with_bits(state.ranges, bits)
    parts.close(bits, code_ranges(state.ranges, image, then, places, sources[0]))
    kinds = [image.ranges]
    if layout.kinds == 2:
        second = np.zeros_like(sources[1])
        then_kinds = [then.ranges, then.ranges]
        if before is not None:
            second[:PAD] = before.kinds[1][-PAD:]
            then_kinds = list(map(_extended, before.kinds))
        bits = parts.open(columns * layout.lasers * 48)
        state.second = second_with_bits(state.second, bits)
        whole = code_second(
            state.second, second, image.ranges, then_kinds[1], then_kinds[0], places, sources[1],
            sources[0],
        )  # fmt: skip
        parts.close(bits, whole)
        kinds.append(second)
    return _Before(azimuths, image, kinds)


def _code_values(
    state: _State, now: _Before, places: Ints, values: Values, parts: _PartWriter | _PartReader, *,
    lean: bool,
) -> None:  # fmt: skip
    """Code the reflectivities of each kind; they are kept in `now` for the next turn."""
    layout, before = state.layout, state.before
    if not state.reflectivities:
        bits = bit_writer(0)
        lasers, kinds = layout.lasers, range(layout.kinds)
        state.reflectivities = [new_byte_model(bits, lasers, lean) for _ in kinds]
    for kind in range(layout.kinds):
        own, ranges = _padded(values[kind]), now.kinds[kind]
        held, then = np.zeros_like(own), np.zeros((1, layout.lasers), np.int32)
        then_ranges, guesses = then, np.zeros_like(own)
        if before is not None and before.values:
            own[:PAD], held[:PAD] = before.values[kind][-PAD:], before.held[kind][-PAD:]
            then, then_ranges = _extended(before.values[kind]), _extended(before.kinds[kind])
        elif before is not None:
            places = np.zeros_like(places)
        if kind == 1:
            guesses = np.where(ranges == now.kinds[0], now.values[0] + 1, 0).astype(np.int32)
        bits = parts.open(len(own) * layout.lasers * 9)
        model = state.reflectivities[kind] = bytes_with_bits(state.reflectivities[kind], bits)
        turn = Bytes(own, held, ranges, then, then_ranges, guesses)
        parts.close(bits, code_reflectivities(model, turn, places))
        now.values.append(own)
        now.held.append(held)


def _padded(values: Values) -> Words:
    """Values after PAD rows of 0; in the order of rows, for which the loops are compiled."""
    padded = np.zeros((PAD + len(values), values.shape[1]), np.int32)
    padded[PAD:] = values
    return padded


def _extended(values: Words) -> Words:
    extended = np.zeros((len(values) + PAD, values.shape[1]), np.int32)
    extended[: len(values)] = values
    return extended


def _places(state: _State, azimuths: Ints) -> Ints:
    """Row of the nearest column of the turn before, of each column; 0 where none is near."""
    per_block = state.layout.columns_per_block
    if state.before is None:
        return np.zeros(len(azimuths) * per_block, np.int64)
    now = _column_azimuths(azimuths, per_block)
    then = _column_azimuths(state.before.azimuths, per_block)
    turn = CENTIDEGREES * per_block
    now += -((now[0] - then[0] + turn // 2) // turn) * turn
    right = np.searchsorted(then, now).clip(1, max(len(then) - 1, 1))
    right = np.minimum(right, len(then) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(now - then[left] <= then[right] - now, left, right)
    is_near = np.abs(then[nearest] - now) < _NEAREST * per_block
    return np.where(is_near, nearest + PAD, 0).astype(np.int64)


def _column_azimuths(azimuths: Ints, per_block: int) -> Ints:
    """Azimuths of columns, ascending, in 0.01 degrees / columns of a block."""
    rises = np.diff(azimuths) % CENTIDEGREES
    starts = azimuths[0] + np.concatenate([[0], np.cumsum(rises)])
    last = rises[-1:] if len(rises) else np.zeros(1, np.int64)
    within = np.arange(per_block) * np.concatenate([rises, last])[:, None]
    columns: Ints = (starts[:, None] * per_block + within).ravel()
    return columns
