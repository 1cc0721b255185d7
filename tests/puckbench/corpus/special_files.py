"""Pipes under the names of recordings: a reader would wait for ever."""

from __future__ import annotations

import os

from tests.support.corpus_case import Case, Reader

_READERS: dict[str, Reader] = {
    **dict.fromkeys(("pcap", "bag", "mcap", "pcap.gz"), "returns"),
    "puck": "turns",
}

CASES = [
    Case(f"pipe.{suffix}", os.mkfifo, reader, error=rf"pipe\.{suffix}: a pipe, not a file$")
    for suffix, reader in _READERS.items()
]
