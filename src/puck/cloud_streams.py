"""Encoding and decoding of the clouds of a recording, topic by topic.

The clouds of a topic form a stream: they have the same fields and frame, and similar numbers of
points. Each stream has a number in the recording, and an encoder whose models adapt from cloud to
cloud.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from puck.cloud_data import CloudDecoder, CloudEncoder, CloudLayout
from puck.cloud_messages import FoundCloud
from puck.options import CodingOptions
from puck.records import Record, RecordKind, check

_MOST_STREAMS = 8
_MOST_FACTOR = 2
"""Maximum factor between the numbers of points of successive clouds of a stream."""


_VALUE_BYTES, _RANGES_PER_CLOUD = 4, 1024


def cloud_ranges(size: int) -> int:
    """Return how many ranges a cloud of `size` bytes counts for the limits of a decoder."""
    return size // _VALUE_BYTES + _RANGES_PER_CLOUD


@dataclass
class _Stream:
    encoder: CloudEncoder
    source: tuple[bytes, bytes, bool]
    points: int = 0
    since_key: int = 0
    last: int = 0

    def factor(self, cloud: FoundCloud) -> float:
        few, many = sorted((self.points, cloud.points))
        return many / few


def _source(cloud: FoundCloud) -> tuple[bytes, bytes, bool]:
    return cloud.layout.packed(), cloud.frame, cloud.height > 1


class CloudsEncoder:
    """Encoder of the clouds of a recording, which finds the stream of each cloud."""

    def __init__(self, options: CodingOptions) -> None:
        self._options = options
        self._streams: list[_Stream] = []
        self._count = 0

    def encode(self, cloud: FoundCloud, data: bytes) -> list[Record]:
        """Return the records of a cloud with the bytes `data`.

        A CLOUD_LAYOUT record is the first if the cloud begins a stream.
        """
        records = []
        number = self._stream_of(cloud)
        if number is None:
            number = self._new_stream(cloud)
            body = bytes([number]) + cloud.layout.packed()
            records.append(Record(RecordKind.CLOUD_LAYOUT, body))
        stream = self._streams[number]
        is_key = not stream.points or 0 < self._options.key_every <= stream.since_key
        stream.since_key = 1 if is_key else stream.since_key + 1
        self._count += 1
        stream.points, stream.last = cloud.points, self._count
        body = stream.encoder.encode(data, cloud.width, cloud.height, cloud.row_step, is_key=is_key)
        return [*records, Record(RecordKind.CLOUD, bytes([number]) + body)]

    def _stream_of(self, cloud: FoundCloud) -> int | None:
        factors = [
            (stream.factor(cloud), number)
            for number, stream in enumerate(self._streams)
            if stream.source == _source(cloud)
        ]
        factor, number = min(factors, default=(0.0, None))
        return number if factor <= _MOST_FACTOR else None

    def _new_stream(self, cloud: FoundCloud) -> int:
        stream = _Stream(CloudEncoder(cloud.layout, self._options), _source(cloud))
        if len(self._streams) < _MOST_STREAMS:
            self._streams.append(stream)
            return len(self._streams) - 1
        number = min(range(_MOST_STREAMS), key=lambda each: self._streams[each].last)
        self._streams[number] = stream
        return number


class CloudsDecoder:
    """Decoder of the records of a `CloudsEncoder`.

    Call a method for each record in the order of the stream, and `take` to get the clouds' bytes.

    Parameters
    ----------
    admit
        Function that is called with the number of bytes of a cloud before they are decoded. It
        raises InputError if the cloud is too large.
    """

    def __init__(self, admit: Callable[[int], None]) -> None:
        self._admit = admit
        self._decoders: dict[int, tuple[CloudDecoder, int]] = {}
        self._clouds: list[bytes] = []

    def start_layout(self, body: bytes) -> None:
        """Begin a stream of clouds, which the body of a CLOUD_LAYOUT record describes."""
        check(len(body) > 1 and body[0] < _MOST_STREAMS)
        layout = CloudLayout.unpacked(body[1:])
        check(layout.point_step > 0)
        self._decoders[body[0]] = CloudDecoder(layout), layout.point_step

    def add_cloud(self, body: bytes) -> int:
        """Decode the body of a CLOUD record for `take`, and return the number of points.

        Raises InputError if the body is damaged, or if no stream has its number.
        """
        check(len(body) > 1 and body[0] in self._decoders)
        decoder, point_step = self._decoders[body[0]]
        cloud = decoder.decode(body[1:], self._admit)
        self._clouds.append(cloud)
        return len(cloud) // point_step

    def take(self) -> list[bytes]:
        """Return the bytes of the clouds that were decoded since the last call."""
        clouds, self._clouds = self._clouds, []
        return clouds
