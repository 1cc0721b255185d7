"""The commands ``compress`` and ``decompress`` of ``python -m puck`` and of ``puckbench``."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from pointkit.errors import InputError
from pointkit.terminal import PIPE
from puck.options import EFFORTS

_ZSTANDARD = b"\x28\xb5\x2f\xfd"
"""First bytes of files that Zstandard compressed, such as ROS 2 bags."""
_LOG = logging.getLogger(__name__)


def add_compress_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command ``compress`` to `parser`; `run_compress` reads them."""
    add = parser.add_argument
    add("recording", type=Path, help="packet capture or bag (any file); -: standard input")
    add("out", type=Path, help="file to write (.puck); -: standard output")
    add("--effort", choices=EFFORTS, default="normal", help="speed against size (default: normal)")
    text = (
        "number of turns from one key turn, which can be decoded alone, to the next (default: 50); "
        "0: only the first turn is a key turn"
    )
    add("--key-every", type=_integer, default=50, metavar="TURNS", help=text)


def add_decompress_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command ``decompress`` to `parser`; `run_decompress` reads them."""
    add = parser.add_argument
    add("stream", type=Path, help="file that `compress` wrote (.puck); -: standard input")
    add("out", type=Path, help="recording to write; -: standard output")
    text = "do not limit the size of the recording in proportion to that of the file"
    add("--trusted", action="store_true", help=text)


def _integer(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not an integer of at least 0")
    return int(text)


def run_compress(options: argparse.Namespace) -> dict[str, Any]:
    """Compress the recording that the parsed arguments `options` name.

    Returns
    -------
    dict
        Counts and sizes in bytes by name, as the command prints them.
    """
    from pointkit.terminal import Progress
    from puck.options import CodingOptions
    from puck.recording import compress

    coding = CodingOptions(effort=options.effort, key_every=options.key_every)
    with _pipes(options.recording, options.out) as (recording, out):
        summary = compress(recording, out, coding, Progress("byte"))
    source = "standard input" if options.recording == PIPE else options.recording
    by_lzma = {
        "data packets": summary.packets_by_lzma,
        "PointCloud2 messages": summary.clouds_by_lzma,
    }
    if any(by_lzma.values()):
        _LOG.warning(
            "%s: LZMA alone compresses %s, as models would take more bytes or exceed limits",
            source,
            " and ".join(f"{count:,} {what}" for what, count in by_lzma.items() if count),
        )
    elif not summary.packets and not summary.clouds:
        _LOG.warning(
            "%s: no data packets of a modelled sensor and no PointCloud2 messages: LZMA alone%s "
            "(an Ouster's packets need the sensor's .json beside the recording or its metadata in "
            "the bag)",
            source,
            "" if options.recording == PIPE else _content_told(options.recording),
        )
    if summary.kept:
        _LOG.warning(
            "%s: %d of %d compressed chunks are stored as they are, since compressing them again "
            "gives other bytes: decompress the bag first (rosbag decompress, mcap decompress)",
            source,
            summary.kept,
            summary.kept + summary.opened,
        )
    return summary.as_json()


def _content_told(recording: Path) -> str:
    """Return what a bag or a compressed file contains, as a part of a message."""
    from pointkit.files import open_file
    from puck.recordings.point_cloud2 import POINT_CLOUD2
    from puck.recordings.ros_bags import is_bag, read_topics
    from puck.recordings.topics import listed

    try:
        with open_file(recording) as file:
            start = file.read(len(_ZSTANDARD))
        if start == _ZSTANDARD:
            return "; the file is compressed by Zstandard: decompress it first"
        topics = read_topics(recording) if is_bag(recording) else {}
    except InputError:
        return ""
    if not topics:
        return ""
    names = [f"{name} ({topic.kind}: {topic.messages})" for name, topic in topics.items()]
    told = f"; the bag has {listed(names)}"
    if any(topic.kind == POINT_CLOUD2 and topic.messages for topic in topics.values()):
        told += ", whose messages or chunks are compressed: decompress the bag first"
    return told


def run_decompress(options: argparse.Namespace) -> dict[str, Any]:
    """Restore the recording that the parsed arguments `options` name.

    Returns
    -------
    dict
        Counts and sizes in bytes by name, as the command prints them.
    """
    from pointkit.terminal import Progress
    from puck.recording import decompress

    with _pipes(options.stream, options.out) as (stream, out):
        summary = decompress(stream, out, Progress("byte"), trusted=options.trusted)
    return summary.as_json()


@contextmanager
def _pipes(source: Path, out: Path) -> Iterator[tuple[Path | IO[bytes], Path | IO[bytes]]]:
    """Replace the path ``-`` by standard input and output, and tell their faults in one line."""
    if out == PIPE and sys.stdout.isatty():
        raise InputError("standard output is a terminal, and the output is binary: name a file")
    try:
        yield (
            sys.stdin.buffer if source == PIPE else source,
            sys.stdout.buffer if out == PIPE else out,
        )
    except OSError as error:
        if isinstance(error.filename, str):
            raise
        if out == PIPE:  # the interpreter flushes what is left, which would fail again
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise InputError(f"standard input or output: {error.strerror}".lower()) from error
