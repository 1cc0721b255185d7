"""Decoders of the returns' codec for benchmarks/checks/fuzz.py, and whole streams to damage."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from puck import CodingOptions, compress, decode_turns, decompress, encode_turns
from puck.recordings.packet_turns import split_turns, turn_of
from tests.support import ouster
from tests.support.cloud_bags import cloud_bag
from tests.support.cloud_turns import turns
from tests.support.spinning import DUAL, HDL32E, STRONGEST, VLP16, pcap, rows, spin

_EFFORTS = ("fast", "normal", "thorough")
_PROFILES = ("RNG15_RFL8_NIR8_DUAL", "LEGACY", "RNG19_RFL8_SIG16_NIR16_DUAL")
_BAGS = (("bag", "LZ4"), ("bag", "BZ2"), ("db3", None), ("mcap", None))
_KINDS = ((VLP16, STRONGEST), (VLP16, DUAL), (HDL32E, STRONGEST))


class TurnsDecoder:
    """Decodes the turns of a stream."""

    def streams(self) -> list[bytes]:
        """Streams of each effort and kind of packets, with loss and without."""
        result = []
        for number, (product, mode) in enumerate(_KINDS):
            parts = list(split_turns(spin(product, mode, packets=12, rise=700)))
            turns = [turn_of(kind, payloads) for kind, payloads in parts]
            for step, effort in enumerate(_EFFORTS, 1):
                settings = CodingOptions(effort=effort, step=step, times=number > 0)
                result.append(encode_turns(turns, parts[0][0].layout, settings))
        return result

    def decode(self, stream: bytes) -> NDArray[np.float64]:
        """The ranges of all turns."""
        ranges = [turn.ranges.ravel() for turn in decode_turns(stream)]
        return np.concatenate([np.zeros(0), *ranges])


class RecordingDecoder:
    """Gives back the recording of a stream."""

    def streams(self) -> list[bytes]:
        """Streams of short recordings with another packet."""
        with TemporaryDirectory() as folder:
            whole, small = Path(folder, "a"), Path(folder, "b")
            result = []
            for effort, (product, mode) in zip(_EFFORTS, _KINDS, strict=True):
                packets = rows(spin(product, mode, packets=12, rise=700))
                whole.write_bytes(pcap([*packets[:4], b"\0" * 512, *packets[4:]]))
                compress(whole, small, CodingOptions(effort=effort))
                result.append(small.read_bytes())
            for effort, profile in zip(_EFFORTS, _PROFILES, strict=True):
                about = ouster.metadata(profile)
                whole.with_suffix(".json").write_text(json.dumps(about))
                packets = ouster.packets(profile, *ouster.images(profile))[:4]
                whole.write_bytes(ouster.capture([*packets[:2], b"\0" * 48, *packets[2:]]))
                compress(whole, small, CodingOptions(effort=effort))
                result.append(small.read_bytes())
            others = rows(spin(packets=6, rise=700))
            whole.write_bytes(ouster.capture([*packets[:2], *others, *packets[2:]]))
            compress(whole, small)  # packets of two formats
            return [*result, small.read_bytes()]

    def decode(self, stream: bytes) -> NDArray[np.float64]:
        """The recording's bytes."""
        with TemporaryDirectory() as folder:
            small, back = Path(folder, "a"), Path(folder, "b")
            small.write_bytes(stream)
            decompress(small, back)
            return np.frombuffer(back.read_bytes(), np.uint8).astype(np.float64)


class BagDecoder(RecordingDecoder):
    """Gives back the bag of clouds of a stream."""

    def streams(self) -> list[bytes]:
        """Streams of small bags: clouds with lasers and times, without, and of several rows."""
        clouds = turns(2)
        plain = [cloud[["x", "y", "z"]][::9] for cloud in clouds]
        image = [cloud[:900].reshape(30, 30) for cloud in clouds]
        topics = {"/turns": clouds, "/plain": plain, "/image": image}
        with TemporaryDirectory() as folder:
            small, result = Path(folder, "a.puck"), []
            for number, (suffix, compression) in enumerate(_BAGS):
                path = Path(folder, f"{number}.{suffix}")
                cloud_bag(path, topics, compression=compression)
                for effort in _EFFORTS:
                    compress(path, small, CodingOptions(effort=effort))
                    result.append(small.read_bytes())
            packets = rows(spin(VLP16, STRONGEST, packets=12, rise=700))
            path.write_bytes(path.read_bytes() + pcap(packets))
            compress(path, small)
            return [*result, small.read_bytes()]


DECODERS: dict[str, Callable[[], TurnsDecoder | RecordingDecoder]] = {
    "puck": TurnsDecoder,
    "puck (recording)": RecordingDecoder,
    "puck (bag)": BagDecoder,
}
