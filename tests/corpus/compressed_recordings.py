"""Compressed recordings (.puck) that would unpack to far more than their size allows."""

from __future__ import annotations

import lzma
from pathlib import Path

from puckbench.coding.byte_io import base_128
from puckbench.puck import compress
from puckbench.puck.records import Record, RecordKind, join_records
from tests.corpus.case import Case, content
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


CASES = [
    Case(
        "zeros.puck",
        lambda path: path.write_bytes(_zeros(8)),
        "turns",
        error=r"zeros\.puck: \d+ bytes in \d+ bytes: more than they can hold; .* --trusted",
    ),
    Case("nested.puck", _nested, "turns", error=r"nested\.puck: a compressed recording within"),
    Case(
        "torn.puck", content(b"PUCK\x02\x03"), "turns", error=r"torn\.puck: the stream is damaged"
    ),
]
