"""Compressed recordings (.puck) that would unpack to far more than their size allows."""

from __future__ import annotations

import lzma
from pathlib import Path

from pointkit.coding.byte_io import base_128
from puck import compress, decompress
from puck.recordings.packet_turns import returns_of_packets
from puck.records import Record, RecordKind, join_records
from tests.support.corpus_case import Case, content
from tests.support.spinning import pcap, rows, spin

_ZEROS = 1 << 24
_LZMA2 = [{"id": lzma.FILTER_LZMA2, "dict_size": 1 << 24}]


def _zeros(records: int) -> bytes:
    """A stream of records of 16 MiB of zeros between no packets."""
    gaps = base_128(1) + base_128(_ZEROS) + base_128(1) + bytes(_ZEROS)
    packed = lzma.compress(gaps, lzma.FORMAT_RAW, filters=_LZMA2)
    record = Record(RecordKind.GAPS, base_128(0) + base_128(len(gaps)) + packed)
    return join_records([record] * records)


def _nested(path: Path) -> None:
    inner = path.with_name("inner")
    inner.write_bytes(pcap(rows(spin(packets=4))))
    compress(inner, path)
    path.replace(inner)
    compress(inner, path)
    inner.unlink()


def _late(path: Path) -> None:
    """A capture of which every third packet comes before the one before; it comes back."""
    packets = rows(spin(packets=60))
    packets[2::3], packets[1::3] = packets[1::3], packets[2::3]
    capture = path.with_name("late.pcap")
    capture.write_bytes(pcap(packets))
    compress(capture, path)
    decompress(path, again := path.with_name("again.pcap"))
    assert again.read_bytes() == capture.read_bytes()


CASES = [
    Case(
        "late.puck",
        _late,
        "turns",
        points=returns_of_packets(spin(packets=60)).points(),
        warning=r"late\.puck: sorted by the sensor's clock, as 20 packets are late$",
    ),
    Case(
        "zeros.puck",
        lambda path: path.write_bytes(_zeros(8)),
        "turns",
        error=r"zeros\.puck: \d+ bytes in \d+ bytes: more than they can hold; .* --trusted",
    ),
    Case("nested.puck", _nested, "turns", error=r"nested\.puck: a compressed recording within"),
    Case(
        "torn.puck", content(b"PUCK\x03\x03"), "turns", error=r"torn\.puck: the stream is damaged"
    ),
]
