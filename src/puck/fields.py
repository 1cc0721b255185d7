"""Coding of an Ouster's packet data beyond turns: further images, headers and checksums."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.context_mixing import Ints, Words
from pointkit.errors import InputError
from pointkit.lidar.turns import Turn, by_elevation, by_laser
from pointkit.threads import in_threads
from puck.channels import ChannelContext, ChannelModel, code_channel, new_channel_model
from puck.gaps import decode_gaps, encode_gaps
from puck.options import EFFORTS, Effort
from puck.quick_images import ImageCoder, ImageJob, framed
from puck.ranges import PAD
from puck.recordings.ouster_packets import HEAD_BYTES, OusterKind, Rest
from puck.records import DAMAGED, check
from puck.turns import PartReader, Parts, PartWriter, continued, nearest_columns, padded, with_coder

_DECISIONS = 48
"""Approximate maximum number of decisions for a value."""
_ROW_BYTES, _MORE_BYTES = 10, 64
"""Limits of the bytes that state the lengths of rows of bytes: for each row, and in addition."""
_WIDTHS = (0, 8, 16)
"""Possible numbers of bits of an image's values. With 0 bits, all values are 0."""

Image = NDArray[np.uint16] | Words


@dataclass
class _State:
    models: dict[int, ChannelModel] = field(default_factory=dict)
    coded: dict[int, ChannelContext] = field(default_factory=dict)
    azimuths: Ints | None = None
    images: ImageCoder = field(default_factory=ImageCoder)


class FieldsEncoder:
    """Encoder of the data in successive turns' packets that the turns do not hold."""

    def __init__(self, kind: OusterKind, effort: Effort) -> None:
        self._kind, self._effort, self._state = kind, effort, _State()

    def encode(self, turn: Turn, rest: Rest, *, is_key: bool) -> bytes:
        """Return the bytes that encode the further data `rest` of a turn's packets.

        If `is_key`, they can be decoded without those of earlier turns.
        """
        if is_key:
            self._state = _State()
        layout, writer = self._kind.layout, PartWriter()
        widths = [_width(image) for image in rest.images]
        images: list[Image] = [
            by_elevation(image[None], layout)[0] if width else image
            for image, width in zip(rest.images, widths, strict=True)
        ]
        _code_images(self._kind, self._state, turn, images, widths, writer, self._effort)
        flags = EFFORTS.index(self._effort) << 1 | rest.has_crc
        rows = [*rest.outsides, *rest.heads] if self._kind.outside_bytes else [*rest.heads]
        rows.append(rest.remainders.astype("<u2").view(np.uint8).reshape(-1, 2).T.ravel())
        gaps = encode_gaps([row.tobytes() for row in rows], are_headers=True)
        return bytes([flags, *widths]) + base_128(rest.unit) + writer.joined() + gaps


class FieldsDecoder:
    """Decoder of the bytes of a `FieldsEncoder`, which takes the turns in the same order."""

    def __init__(self, kind: OusterKind) -> None:
        self._kind = kind
        self._state: _State | None = _State()

    def decode(self, body: bytes, turn: Turn, *, is_key: bool) -> Rest:
        """Return the further data of a turn's packets, which `FieldsEncoder.encode` encoded as
        `body`.

        Raises InputError if `body` is damaged.
        """
        kind, columns, reader = self._kind, len(turn.azimuths), Reader(body)
        state = _State() if is_key else self._state
        self._state = None  # no other turn may use the models of a damaged turn
        flags, *widths = reader.take(1 + len(kind.channels))
        unit = reader.number()
        if state is None or flags >> 1 >= len(EFFORTS) or not set(widths) <= set(_WIDTHS):
            raise InputError(DAMAGED)
        shape, parts = (columns, kind.layout.lasers), PartReader(reader)
        images: list[Image] = [np.zeros(shape, np.uint16) for _ in widths]
        images = _code_images(kind, state, turn, images, widths, parts, EFFORTS[flags >> 1])
        packets = columns // kind.columns_per_packet if kind.outside_bytes else 0
        outsides, heads, low_high = _decode_rows(reader, packets, columns, kind.outside_bytes)
        remainders = np.frombuffer(low_high, np.uint8).reshape(2, -1).T.copy().view("<u2")[:, 0]
        self._state = state
        decoded = [by_laser(image[None].astype(np.uint16), kind.layout)[0] for image in images]
        return Rest(decoded, heads, outsides, remainders, unit, bool(flags & 1))


def _decode_rows(
    reader: Reader, packets: int, columns: int, outside_bytes: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], bytes]:
    sizes = [outside_bytes] * packets + [HEAD_BYTES] * columns + [2 * columns]
    most = sum(sizes) + _ROW_BYTES * len(sizes) + _MORE_BYTES
    rows = decode_gaps(reader, len(sizes), lambda size: check(size <= most))
    check([len(row) for row in rows] == sizes)
    outsides = np.frombuffer(b"".join(rows[:packets]), np.uint8).reshape(packets, outside_bytes)
    heads = np.frombuffer(b"".join(rows[packets:-1]), np.uint8).reshape(columns, HEAD_BYTES)
    return outsides, heads, rows[-1]


def _width(image: Image) -> int:
    most = int(image.max(initial=0))
    return 0 if most == 0 else 8 if most < 256 else 16


def _code_images(
    kind: OusterKind, state: _State, turn: Turn, images: list[Image], widths: list[int],
    parts: Parts, effort: Effort,
) -> list[Image]:  # fmt: skip
    azimuths, layout = turn.azimuths.astype(np.int64), kind.layout
    nearest = nearest_columns(azimuths, state.azimuths, layout)
    state.azimuths = azimuths
    code = _code_quickly if effort == "fast" else partial(_code_mixed, effort=effort)
    ranges = by_elevation(turn.ranges, layout)
    return code(kind, state, ranges, nearest, images, widths, parts)


def _code_mixed(
    kind: OusterKind, state: _State, turn_ranges: NDArray[Any], nearest: Ints, sources: list[Image],
    widths: list[int], parts: Parts, effort: Effort,
) -> list[Image]:  # fmt: skip
    lasers = kind.layout.lasers
    ranges, images = list(map(padded, turn_ranges)), list(map(padded, sources))
    bits = {k: parts.open(images[k].size * _DECISIONS) for k, width in enumerate(widths) if width}

    def code(number: int) -> bool:
        channel, values, farthest = kind.channels[number], images[number], (1 << widths[number]) - 1
        signal = values if channel.signal is None else images[channel.signal]
        errors, estimates = np.zeros_like(values), np.zeros_like(values)
        context = ChannelContext(values, errors, estimates, ranges[channel.kind], signal)
        model = state.models.get(number)
        if model is None or model.farthest != farthest:
            has_signals = channel.signal is not None
            model = new_channel_model(
                bits[number], lasers, effort, farthest, has_signals=has_signals
            )
        model = state.models[number] = with_coder(model, bits[number])
        earlier = state.coded.get(number)
        rows = 0 * nearest if earlier is None else nearest
        is_complete = code_channel(model, context, continued(context, earlier), rows)
        state.coded[number] = context
        return is_complete

    state.coded = {number: state.coded[number] for number in bits if number in state.coded}
    is_complete: dict[int, bool] = {}
    for is_dependent in (False, True):
        numbers = [k for k in bits if (kind.channels[k].signal is not None) == is_dependent]
        is_complete |= zip(numbers, in_threads(code, numbers), strict=True)
    for number, coder in bits.items():
        parts.close(coder, is_complete[number])
    return [image[PAD:] for image in images]


def _code_quickly(
    kind: OusterKind, state: _State, turn_ranges: NDArray[Any], nearest: Ints, sources: list[Image],
    widths: list[int], parts: Parts,
) -> list[Image]:  # fmt: skip
    ranges, images = list(map(framed, turn_ranges)), [*sources]
    coded: dict[int | None, Words] = {}
    state.images.keep([number for number, width in enumerate(widths) if width])
    for is_dependent in (False, True):
        jobs = []
        for number, (image, width, channel) in enumerate(
            zip(images, widths, kind.channels, strict=True)
        ):
            if width and (channel.signal is not None) == is_dependent:
                signals = coded.get(channel.signal, np.zeros_like(ranges[0]))
                jobs.append(ImageJob(
                    number, image, (1 << width) - 1, ranges[channel.kind],
                    signals if is_dependent else None,
                ))  # fmt: skip
        results = parts.code_images(state.images, jobs, nearest)
        coded |= {job.number: image for job, image in zip(jobs, results, strict=True)}
    inside = (slice(PAD, -PAD), slice(1, -1))
    return [coded[k][inside] if k in coded else image for k, image in enumerate(images)]
