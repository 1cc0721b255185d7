from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

from cloud_files import meshes
from cloud_files.clouds import SUFFIXES
from cloud_files.content import plain_suffix, read_content
from pointkit.errors import InputError, naming
from pointkit.lidar.returns import Returns, read_firings
from puck.recordings.captured_packets import is_packet_capture
from puck.recordings.ouster import is_osf
from puck.recordings.pcap import refuse_stream
from puck.recordings.ros_bags import bag_format
from puck.recordings.topics import refuse_topic
from puckbench.scene_sets.recordings import RECORDING_SUFFIXES, decompressed

_log = logging.getLogger(__name__)
_LONGEST_MARK = 24
"""Number of bytes at the start of a file that identify packet captures and bags."""


def is_recording(path: Path) -> bool:
    """Return whether a path is a recording: a packet capture, a ROS bag or a folder.

    OSF files count as well, so that the reader of recordings can tell how to convert them.
    A file with a known suffix is judged by the suffix, and another file by its first bytes.
    """
    if path.is_dir() or path.suffix.lower() in RECORDING_SUFFIXES:
        return True
    if plain_suffix(path) in (".parquet", *SUFFIXES, *meshes.SUFFIXES) or not path.exists():
        return False
    start = read_content(path, _LONGEST_MARK)
    return is_packet_capture(start) or bag_format(start) is not None or is_osf(start)


def check_selection(path: Path, stream: str | None, topic: str | None) -> None:
    """Raise InputError if a sensor or topic is selected in a file that is no recording."""
    if not is_recording(path):
        refuse_stream(stream)
        refuse_topic(topic)


def read_selected_turns(
    path: Path, turns: tuple[int, int] | None, stream: str | None = None, topic: str | None = None
) -> tuple[Returns, dict[str, int]]:
    """Read selected turns of a recording, or of a table of firings.

    Parameters
    ----------
    path
        The recording, or the table (Parquet).
    turns
        Numbers, from 0, of the first and last turn to read. None reads the first whole turn of a
        recording, and all turns of a table.
    stream, topic
        Sensor of a packet capture, or topic of a ROS bag, to read; needed if there are several.

    Returns
    -------
    tuple[Returns, dict[str, int]]
        The sensor's returns, and the numbers of damaged or missing data by kind.
    """
    from puck.turn_packets import index_turns
    from puckbench.recordings.long_recordings import is_long, read_some_turns
    from puckbench.recordings.reading import read_turns

    with naming(path):
        check_selection(path, stream, topic)
        if not is_recording(path):
            return select_turns(read_firings(path), turns), {}
        first, last = turns or (0, 1)
        recorded, skipped = None, 0
        if stream is None and topic is None and is_long(path):
            index = index_turns(path)
            recorded = read_some_turns(index, first, last) if index else None
            skipped = first if recorded else 0
        if recorded is None:
            with decompressed(path) as recording:
                recorded = read_turns(recording, 0.0, stream, path, topic)
        returns, whole, left_out, _ = recorded
        if turns is None:
            first = last = whole[0] if whole else min(1, len(returns.turns) - 1)
        selected = select_turns(returns, (first - skipped, last - skipped))
    taken = range(first, last + 1)
    if not whole:
        _log.warning("%s: has no whole turn: takes a part of one", path)
    elif cut := [number for number in taken if number not in whole]:
        of_whole = f"whole turns are {whole[0]} to {whole[-1]}"
        _log.warning("%s: takes turn %d, which is cut off: %s", path, cut[0], of_whole)
    return selected, left_out


def select_turns(returns: Returns, turns: tuple[int, int] | None) -> Returns:
    """Return the part of a sensor's returns that is in selected turns (revolutions).

    Parameters
    ----------
    returns
        Returns of several turns.
    turns
        Numbers, from 0, of the first and last turn to keep; None keeps all turns.

    Raises
    ------
    InputError
        A selected turn does not exist.
    """
    first, last = turns or (0, len(returns.turns) - 1)
    if not 0 <= first <= last < len(returns.turns):
        most = len(returns.turns) - 1
        raise InputError(f"has turns 0 to {most}, not {first} to {last}")
    return replace(returns, turns=returns.turns[first : last + 1])
