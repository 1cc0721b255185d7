"""Coding of one turn as separate parts: azimuths, ranges, second returns, times, reflectivities.

A turn is one revolution of the sensor. A key turn can be decoded alone; other turns continue with
the adaptive models of the turn before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.binary_coder import BitCoder, bit_reader, bit_writer, read_to_its_end, written
from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.context_mixing import Ints, Mixer, Words
from pointkit.errors import InputError
from pointkit.lidar.turns import (
    CENTIDEGREES,
    MAX_RANGE,
    Layout,
    Ranges,
    Turn,
    by_elevation,
    by_laser,
    check_turn,
    has_wide_ranges,
)
from puck.channels import ChannelContext, ChannelModel, code_channel, new_channel_model
from puck.options import EFFORTS, MAX_STEP, CodingOptions
from puck.quick_images import ImageCoder, ImageJob
from puck.ranges import PAD, RangeContext, RangeModel, code_ranges, model_size, new_range_model
from puck.reflectivity import (
    ReflectivityContext,
    ReflectivityModel,
    code_reflectivities,
    new_reflectivity_model,
)
from puck.second_returns import SecondReturnModel, code_second_returns, new_second_return_model
from puck.sequences import SequenceModel, code_sequence, new_sequence_model

_KEY, _TIMES, _REFLECTIVITIES = 1, 2, 4
_EFFORT = 3
"""Position of the effort's bits in a turn's flags."""
_LEAN = 32
"""Flag: reflectivities are coded with few contexts."""
_WIDE = 64
"""Flag: ranges have 32 bits."""
_QUICK = 128
"""Flag: ranges and reflectivities are coded by `quick_images`."""
_CLOCK = 1 << 32
_FARTHEST_COLUMN = 180
"""A column of the previous turn is a context only within 1 / 180 of a revolution."""
_FIRST_ERROR = 48
_DECISIONS, _WIDE_DECISIONS = 48, 80
"""Approximate maximum number of decisions for a range of 16 or 32 bits."""
_BYTES_PER_DECISION = 2
"""Maximum cost of a decision: a bit has a probability of at least 2**-11."""

Values = Ranges | NDArray[np.uint8] | Words
_Model = TypeVar(
    "_Model", RangeModel, SecondReturnModel, SequenceModel, ReflectivityModel, ChannelModel
)


@dataclass
class _State:
    layout: Layout
    step: int
    effort: int
    is_wide: bool
    is_quick: bool
    azimuths: SequenceModel
    ranges: RangeModel
    second: SecondReturnModel
    times: SequenceModel
    reflectivities: list[ReflectivityModel]
    shades: ChannelModel | None = None  # of an Ouster's reflectivities
    images: ImageCoder = field(default_factory=ImageCoder)
    previous: _CodedTurn | None = None


@dataclass
class _CodedTurn:
    """A coded turn, from which the next turn is predicted.

    Each list has one item for each kind of return (strongest, last).
    """

    azimuths: Ints
    strongest: RangeContext
    ranges: list[Words]
    reflectivities: list[Words] = field(default_factory=list)
    held: list[Words] = field(default_factory=list)
    shades: ChannelContext | None = None  # an Ouster's reflectivities


def _new_state(
    layout: Layout, step: int, lmbda: float, effort: int, is_wide: bool, is_quick: bool
) -> _State:
    bits, lasers = bit_writer(0), layout.lasers
    farthest = _farthest(is_wide)
    size = model_size(EFFORTS[effort], step)
    sixteenths = max(round(16 * lmbda), 1) if lmbda > 0 else 0
    return _State(
        layout, step, effort, is_wide, is_quick,
        new_sequence_model(bits, layout.azimuth_steps),
        new_range_model(bits, lasers, size, step, sixteenths, farthest),
        new_second_return_model(bits, lasers, step, farthest),
        new_sequence_model(bits, _CLOCK),
        [],
    )  # fmt: skip


class TurnEncoder:
    """Encoder of successive turns of one layout, whose models learn from turn to turn.

    Parameters
    ----------
    layout
        Arrangement of lasers and columns in the images of all turns.
    options
        Options of encoding. By default, nothing is lost.
    is_quick
        Whether `puck.quick_images` codes ranges and reflectivities.
    """

    def __init__(
        self, layout: Layout, options: CodingOptions | None = None, *, is_quick: bool = False
    ) -> None:
        self.layout, self.options = layout, options or CodingOptions()
        self._is_quick = is_quick
        self._state: _State | None = None
        self._since_key = 0

    def encode(self, turn: Turn) -> bytes:
        """Return the bytes of the next turn; raise InputError if it does not have the layout."""
        check_turn(turn, self.layout)
        options = self.options
        effort = EFFORTS.index(options.effort)
        is_wide = has_wide_ranges(turn)
        is_key = 0 < options.key_every <= self._since_key
        if self._state is None or is_key or is_wide != self._state.is_wide:
            self._state = _new_state(
                self.layout, options.step, options.lmbda, effort, is_wide, self._is_quick
            )
            self._since_key, is_key = 0, True
        self._since_key += 1
        flags = is_key * _KEY | effort << _EFFORT | (options.effort == "fast") * _LEAN
        flags |= is_wide * _WIDE | self._is_quick * _QUICK
        flags |= (options.times and turn.times is not None) * _TIMES
        flags |= (options.reflectivities and turn.reflectivities is not None) * _REFLECTIVITIES
        writer = PartWriter()
        _code_turn(self._state, _by_elevation(turn, self.layout), flags, writer)
        header = bytes([flags]) + base_128(options.step) + base_128(len(turn.azimuths))
        return header + writer.joined()


class TurnDecoder:
    """Decoder of the successive turns of a `TurnEncoder`, starting with a key turn."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._state: _State | None = None

    def decode(self, body: bytes) -> Turn:
        """Return the turn that the bytes `body` encode.

        Raises InputError if the bytes are damaged or the previous turn, which they need, was not
        decoded.
        """
        reader = Reader(body)
        flags, step, blocks = reader.take(1)[0], reader.number(), reader.number()
        effort = flags >> _EFFORT & 3
        if (
            effort >= len(EFFORTS)
            or not 1 <= step <= MAX_STEP
            or not 1 <= blocks <= self.layout.max_blocks
        ):
            raise InputError("the stream is damaged (a turn's header)")
        is_wide, is_quick = bool(flags & _WIDE), bool(flags & _QUICK)
        if flags & _KEY:
            self._state = _new_state(self.layout, step, 0, effort, is_wide, is_quick)
        state, kind = self._state, (step, effort, is_wide, is_quick)
        if state is None or kind != (state.step, state.effort, state.is_wide, state.is_quick):
            raise InputError("the turn needs the turn before it")
        self._state = None  # no other turn may use the models of a damaged turn
        blank = _blank(blocks, self.layout, is_wide)
        coded, times = _code_turn(state, blank, flags, PartReader(reader))
        if reader.rest():
            raise InputError("the stream is damaged (a turn's length)")
        self._state = state
        return _decoded(state, coded, times)


def is_key(body: bytes) -> bool:
    """Return whether a coded turn can be decoded without the turns before it."""
    return bool(body[:1] and body[0] & _KEY)


def turn_step(body: bytes) -> int:
    """Return the quantisation step of a coded turn's ranges, in the sensor's range units."""
    reader = Reader(body)
    reader.take(1)
    return reader.number()


def reflectivity_bytes(body: bytes, layout: Layout) -> int:
    """Return how many bytes of the coded turn `body` hold reflectivities."""
    reader = Reader(body)
    if not reader.take(1)[0] & _REFLECTIVITIES:
        return 0
    reader.number(), reader.number()
    starts = []
    while reader.at < len(body):
        starts.append(reader.at)
        reader.take(reader.number())
    return len(body) - starts[-layout.kinds] if len(starts) > layout.kinds else 0


def _by_elevation(turn: Turn, layout: Layout) -> Turn:
    values = turn.reflectivities
    return replace(
        turn,
        ranges=by_elevation(turn.ranges, layout),
        reflectivities=None if values is None else by_elevation(values, layout),
    )


def _farthest(is_wide: bool) -> int:
    return MAX_RANGE if is_wide else 0xFFFF


def _range_type(is_wide: bool) -> type[np.uint16] | type[np.uint32]:
    return np.uint32 if is_wide else np.uint16


def _blank(blocks: int, layout: Layout, is_wide: bool) -> Turn:
    shape = (layout.kinds, blocks * layout.columns_per_block, layout.lasers)
    packets = -(-blocks // layout.blocks_per_time)
    return Turn(
        np.zeros(shape, _range_type(is_wide)),
        np.zeros(blocks, np.uint16),
        np.zeros(packets, np.uint32),
        np.zeros(shape, np.uint8),
    )


class PartWriter:
    """Collector of a turn's encoded parts, each of which has its own arithmetic coder."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []

    def open(self, most_decisions: int) -> BitCoder:
        """Return an encoder for the next part, of at most `most_decisions` binary decisions."""
        return bit_writer(most_decisions * _BYTES_PER_DECISION + 64)

    def code_images(self, coder: ImageCoder, jobs: list[ImageJob], nearest: Ints) -> list[Words]:
        """Encode images as the next parts, and return the images as `ImageCoder.encode` does."""
        images, parts = coder.encode(jobs, nearest)
        self.parts += parts
        return images

    def pass_bytes(self, part: bytes) -> bytes:
        """Append bytes as the next part, and return them."""
        self.parts.append(part)
        return part

    def close(self, bits: BitCoder, is_complete: bool) -> None:
        """Append the part that the encoder `bits` has written."""
        del is_complete
        self.parts.append(written(bits))

    def joined(self) -> bytes:
        """Return the bytes of all parts, each after its length in bytes."""
        return b"".join(base_128(len(part)) + part for part in self.parts)


class PartReader:
    """Reader of the parts that a `PartWriter` wrote, for a decoder."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def open(self, most_decisions: int) -> BitCoder:
        """Return a decoder of the next part."""
        del most_decisions
        return bit_reader(self._reader.take(self._reader.number()))

    def code_images(self, coder: ImageCoder, jobs: list[ImageJob], nearest: Ints) -> list[Words]:
        """Decode images from the next parts, and return the images as `ImageCoder.decode` does."""
        parts = [self._reader.take(self._reader.number()) for _ in jobs]
        return coder.decode(jobs, nearest, parts)

    def pass_bytes(self, part: bytes) -> bytes:
        """Return the bytes of the next part; the argument is what an encoder appends."""
        del part
        return self._reader.take(self._reader.number())

    def close(self, bits: BitCoder, is_complete: bool) -> None:
        """Raise InputError unless the part was complete, and was read to its end."""
        if not is_complete or not read_to_its_end(bits):
            raise InputError("the stream is damaged (a turn)")


Parts = PartWriter | PartReader


def _code_turn(
    state: _State, turn: Turn, flags: int, parts: Parts
) -> tuple[_CodedTurn, NDArray[np.uint32] | None]:
    azimuths = turn.azimuths.astype(np.int64)
    state.azimuths = _code_numbers(state.azimuths, azimuths, parts)
    previous = None if state.previous is None else state.previous.azimuths
    nearest = nearest_columns(azimuths, previous, state.layout)
    if state.is_quick:
        coded = _code_images(state, azimuths, nearest, turn, flags, parts)
    else:
        coded = _code_kinds(state, azimuths, nearest, turn, parts)
    times = None
    if flags & _TIMES and turn.times is not None:
        numbers = turn.times.astype(np.int64)
        state.times = _code_numbers(state.times, numbers, parts)
        times = numbers.astype(np.uint32)
    if flags & _REFLECTIVITIES and turn.reflectivities is not None and not state.is_quick:
        lean = bool(flags & _LEAN)
        if EFFORTS[state.effort] == "normal" and _is_one_image(state.layout):
            _code_shades(state, coded, nearest, turn.reflectivities[0], parts)
        else:
            _code_all_reflectivities(state, coded, nearest, turn.reflectivities, parts, lean=lean)
    state.previous = coded
    return coded, times


def _code_numbers(model: SequenceModel, numbers: Ints, parts: Parts) -> SequenceModel:
    return _code_part(parts, model, 64 * len(numbers), code_sequence, numbers)


def _code_part(
    parts: Parts, model: _Model, most_decisions: int, code: Callable[..., bool], *arguments: Any
) -> _Model:
    """Encode or decode a part of a turn by ``code(model, *arguments)``, and return the model."""
    bits = parts.open(most_decisions)
    model = with_coder(model, bits)
    parts.close(bits, code(model, *arguments))
    return model


def with_coder(model: _Model, bits: BitCoder) -> _Model:
    """Return a copy of a model whose mixers use the arithmetic coder `bits`."""
    mixers: dict[str, Any] = {
        name: value._replace(bits=bits)
        for name, value in model._asdict().items()
        if isinstance(value, Mixer)
    }
    return model._replace(**mixers)


def _decoded(state: _State, coded: _CodedTurn, times: NDArray[np.uint32] | None) -> Turn:
    kinds = [kind[PAD:] for kind in coded.ranges]
    ranges: Ranges = np.stack(kinds).astype(_range_type(state.is_wide))
    values = None
    if coded.reflectivities:
        kinds = [kind[PAD:] for kind in coded.reflectivities]
        values = by_laser(np.stack(kinds).astype(np.uint8), state.layout)
    ranges = by_laser(ranges, state.layout)
    return Turn(ranges, coded.azimuths.astype(np.uint16), times, values)


def _code_images(
    state: _State, azimuths: Ints, nearest: Ints, turn: Turn, flags: int, parts: Parts
) -> _CodedTurn:
    ranges: list[Words] = []
    values: list[Words] = []
    farthest, end = _farthest(state.is_wide), PAD + len(nearest)
    has_values = flags & _REFLECTIVITIES and turn.reflectivities is not None
    state.images.keep(range(len(turn.ranges) * (2 if has_values else 1)))
    for kind, image in enumerate(turn.ranges):
        job = ImageJob(kind, image, farthest, reference=ranges[0] if kind else None)
        ranges += parts.code_images(state.images, [job], nearest)
    if flags & _REFLECTIVITIES and turn.reflectivities is not None:
        jobs = [
            ImageJob(len(ranges) + kind, image, 0xFF, ranges[kind])
            for kind, image in enumerate(turn.reflectivities)
        ]
        values = parts.code_images(state.images, jobs, nearest)
    inside = [image[:end, 1:-1] for image in ranges]
    strongest = RangeContext(*inside[:1] * 4)
    return _CodedTurn(azimuths, strongest, inside, [image[:end, 1:-1] for image in values])


def _code_kinds(
    state: _State, azimuths: Ints, nearest: Ints, turn: Turn, parts: Parts
) -> _CodedTurn:
    layout, previous = state.layout, state.previous
    sources = [padded(kind) for kind in turn.ranges]
    decisions = sources[0][PAD:].size * (_WIDE_DECISIONS if state.is_wide else _DECISIONS)
    image = RangeContext(*(np.zeros_like(sources[0]) for _ in range(4)))
    image.errors[:PAD] = _FIRST_ERROR
    before = RangeContext(*(np.zeros((1, layout.lasers), np.int32) for _ in range(4)))
    if previous is not None:
        for rows, earlier in zip(image, previous.strongest, strict=True):
            rows[:PAD] = earlier[-PAD:]
        before = RangeContext(*map(extended, previous.strongest))
    state.ranges = _code_part(
        parts, state.ranges, decisions, code_ranges, image, before, nearest, sources[0]
    )
    ranges = [image.ranges]
    if layout.kinds == 2:
        second, before_kinds = np.zeros_like(sources[1]), [before.ranges, before.ranges]
        if previous is not None:
            second[:PAD] = previous.ranges[1][-PAD:]
            before_kinds = list(map(extended, previous.ranges))
        state.second = _code_part(
            parts, state.second, decisions, code_second_returns,
            second, image.ranges, *before_kinds[::-1], nearest, *sources[::-1],
        )  # fmt: skip
        ranges.append(second)
    return _CodedTurn(azimuths, image, ranges)


def _code_all_reflectivities(
    state: _State, coded: _CodedTurn, nearest: Ints, values: Values, parts: Parts, *, lean: bool
) -> None:
    layout, previous = state.layout, state.previous
    if not state.reflectivities:
        bits, lasers = bit_writer(0), layout.lasers
        state.reflectivities = [
            new_reflectivity_model(bits, lasers, lean) for _ in range(layout.kinds)
        ]
    for kind in range(layout.kinds):
        kind_values, ranges = padded(values[kind]), coded.ranges[kind]
        held, before = np.zeros_like(kind_values), np.zeros((1, layout.lasers), np.int32)
        before_ranges, guesses = before, np.zeros_like(kind_values)
        if previous is not None and previous.reflectivities:
            kind_values[:PAD] = previous.reflectivities[kind][-PAD:]
            held[:PAD] = previous.held[kind][-PAD:]
            before = extended(previous.reflectivities[kind])
            before_ranges = extended(previous.ranges[kind])
        elif previous is not None:
            nearest = np.zeros_like(nearest)
        if kind == 1:
            is_same = ranges == coded.ranges[0]
            guesses = np.where(is_same, coded.reflectivities[0] + 1, 0).astype(np.int32)
        context = ReflectivityContext(kind_values, held, ranges, before, before_ranges, guesses)
        state.reflectivities[kind] = _code_part(
            parts, state.reflectivities[kind], 9 * kind_values.size, code_reflectivities,
            context, nearest,
        )  # fmt: skip
        coded.reflectivities.append(kind_values)
        coded.held.append(held)


def _is_one_image(layout: Layout) -> bool:
    """Return whether a turn is one image: with one return of each firing, and azimuths that are
    multiples of the sensor's step, as those of Ousters are.
    """
    return layout.azimuth_steps != CENTIDEGREES and layout.kinds == 1


def _code_shades(
    state: _State, coded: _CodedTurn, nearest: Ints, values: Values, parts: Parts
) -> None:
    """Code an Ouster's reflectivities like its other images, which takes half the time."""
    lasers, shades = state.layout.lasers, padded(values)
    errors, estimates = np.zeros_like(shades), np.zeros_like(shades)
    context = ChannelContext(shades, errors, estimates, coded.ranges[0], shades)
    earlier = state.previous.shades if state.previous else None
    before = continued(context, earlier)
    nearest = np.zeros_like(nearest) if earlier is None else nearest
    model = state.shades or new_channel_model(
        bit_writer(0), lasers, EFFORTS[state.effort], 0xFF, has_signals=False
    )
    state.shades = _code_part(
        parts, model, _DECISIONS * shades.size, code_channel, context, before, nearest
    )
    coded.reflectivities.append(shades)
    coded.shades = context


def continued(context: ChannelContext, earlier: ChannelContext | None) -> ChannelContext:
    """Let an image continue that of the turn before, which is returned as the coder wants it.

    Parameters
    ----------
    context
        The image to code. Its first PAD rows receive the last rows of the earlier image.
    earlier
        The image of the same kind in the turn before, or None.

    Returns
    -------
    ChannelContext
        Values and errors of the earlier image, with PAD additional rows of zeros at the end; zeros
        without an earlier image.
    """
    before = ChannelContext(*[np.zeros((1, context.values.shape[1]), np.int32)] * 5)
    if earlier is None:
        return before
    for array, rows in zip(context[:3], earlier[:3], strict=True):
        array[:PAD] = rows[-PAD:]
    return before._replace(values=extended(earlier.values), errors=extended(earlier.errors))


def padded(values: Values) -> Words:
    """Return values (rows, ...) as 32-bit integers, after PAD additional rows of zeros."""
    return np.pad(values.astype(np.int32, "C"), ((PAD, 0), (0, 0)))


def extended(values: Words) -> Words:
    """Return values (rows, ...) with PAD additional rows of zeros at the end."""
    return np.pad(values, ((0, PAD), (0, 0)))


def nearest_columns(azimuths: Ints, previous: Ints | None, layout: Layout) -> Ints:
    """Return, for each column of a turn, the column of the previous turn with the nearest azimuth.

    Parameters
    ----------
    azimuths
        Azimuths of the turn's blocks.
    previous
        Azimuths of the previous turn's blocks, or None if there is no previous turn.
    layout
        Arrangement of lasers and columns in both turns.

    Returns
    -------
    array (columns,)
        Row of the nearest column in an array that starts with PAD rows; 0 if no column is near.
    """
    per_block, steps = layout.columns_per_block, layout.azimuth_steps
    if previous is None:
        return np.zeros(len(azimuths) * per_block, np.int64)
    now = _column_azimuths(azimuths, per_block, steps)
    then = _column_azimuths(previous, per_block, steps)
    turn = steps * per_block
    now += -((now[0] - then[0] + turn // 2) // turn) * turn
    right = np.searchsorted(then, now).clip(1, max(len(then) - 1, 1))
    right = np.minimum(right, len(then) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(now - then[left] <= then[right] - now, left, right)
    is_near = np.abs(then[nearest] - now) < max(steps // _FARTHEST_COLUMN, 1) * per_block
    return np.where(is_near, nearest + PAD, 0).astype(np.int64)


def _column_azimuths(azimuths: Ints, per_block: int, steps: int) -> Ints:
    # In azimuth steps / columns of a block, ascending.
    rises = np.diff(azimuths) % steps
    starts = azimuths[0] + np.concatenate([[0], np.cumsum(rises)])
    last = rises[-1:] if len(rises) else np.zeros(1, np.int64)
    within = np.arange(per_block) * np.concatenate([rises, last])[:, None]
    columns: Ints = (starts[:, None] * per_block + within).ravel()
    return columns
