from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from cloud_files import meshes
from cloud_files.clouds import SUFFIXES
from cloud_files.content import plain_suffix, read_content
from pointkit.column_tables import is_table_of
from pointkit.errors import naming
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns, read_firings
from puck.recordings.captured_packets import is_packet_capture
from puck.recordings.pcap import refuse_stream
from puck.recordings.ros_bags import bag_format
from puck.recordings.topics import refuse_topic
from puckbench.jobs.prepare_returns import PrepareReturns, select_turns
from puckbench.jobs.registry import JOBS
from puckbench.scene_sets.recordings import RECORDING_SUFFIXES, decompressed
from virtual_lidar.scan_table import ScanTable

_log = logging.getLogger(__name__)
_LONGEST_MARK = 24
"""Number of bytes at the start of a file that identify packet captures and bags."""


@JOBS.register("prepare_recording")
class PrepareRecording(PrepareReturns):
    """Prepare turns (revolutions) of a sensor as `PrepareReturns` does, also from a recording.

    For a recording, the default of `turns` is the first whole turn.

    Parameters
    ----------
    stream
        Name of the sensor to read, in a packet capture of several sensors.
    topic
        Topic to read, in a ROS bag of several sensors.
    """

    stream: str | None = None
    topic: str | None = None

    def _read(self, path: Path) -> tuple[Returns, PointCloud | None, dict[str, Any]]:
        if is_table_of(path, ScanTable):
            with naming(path):
                _check_selection(path, self.stream, self.topic)
            return super()._read(path)
        returns, left_out = read_selected_turns(path, self.turns, self.stream, self.topic)
        return returns, None, {"source": path.name, "sensor": returns.sensor, **left_out}


def is_recording(path: Path) -> bool:
    """Return whether a path is a recording: a packet capture, a ROS bag or a folder.

    A file with a known suffix is judged by the suffix, and another file by its first bytes.
    """
    if path.is_dir() or path.suffix.lower() in RECORDING_SUFFIXES:
        return True
    if plain_suffix(path) in (".parquet", *SUFFIXES, *meshes.SUFFIXES) or not path.exists():
        return False
    start = read_content(path, _LONGEST_MARK)
    return is_packet_capture(start) or bag_format(start) is not None


def _check_selection(path: Path, stream: str | None, topic: str | None) -> None:
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
    from puckbench.recordings.reading import read_turns

    with naming(path):
        _check_selection(path, stream, topic)
        if not is_recording(path):
            return select_turns(read_firings(path), turns), {}
        with decompressed(path) as recording:
            returns, whole, left_out = read_turns(recording, 0.0, stream, path, topic)
        first = whole[0] if whole else min(1, len(returns.turns) - 1)
        selected = select_turns(returns, turns or (first, first))
    taken = range(first, first + 1) if turns is None else range(turns[0], turns[1] + 1)
    if not whole:
        _log.warning("%s: has no whole turn: takes a part of one", path)
    elif cut := [number for number in taken if number not in whole]:
        of_whole = f"whole turns are {whole[0]} to {whole[-1]}"
        _log.warning("%s: takes turn %d, which is cut off: %s", path, cut[0], of_whole)
    return selected, left_out
