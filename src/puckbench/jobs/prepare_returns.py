from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import Field

from puckbench.core.content import plain_suffix, read_content
from puckbench.core.errors import InputError, naming
from puckbench.datasets.recordings import RECORDING_SUFFIXES, decompressed
from puckbench.geometry.cloud import PointCloud
from puckbench.io import meshes
from puckbench.io.clouds import SUFFIXES, write_cloud
from puckbench.io.parquet_files import parquet_metadata
from puckbench.io.recordings.captured_packets import is_packet_capture
from puckbench.io.recordings.pcap import refuse_stream
from puckbench.io.recordings.ros_bags import bag_format
from puckbench.io.recordings.topics import refuse_topic
from puckbench.jobs.prepare import names_and_groups
from puckbench.jobs.registry import JOBS, Job
from puckbench.lidar.returns import Returns, read_firings, write_firings
from puckbench.lidar.scan_table import ScanTable

_log = logging.getLogger(__name__)
_LONGEST_MARK = 24
"""Number of bytes at the start of a file that identify packet captures and bags."""


@JOBS.register("prepare_returns")
class PrepareReturns(Job):
    """Convert a scan or recording to a cloud with normals, in metres in the sensor's frame.

    Parameters
    ----------
    turns
        First and last turn, counted from 0; by default all turns of a scan, or the first whole turn
        of a recording.
    peak
        PSNR peak, in m.
    stream
        Sensor to read in a packet capture of several sensors.
    topic
        Topic to read in a ROS bag of several sensors.
    """

    neighbours: int = Field(30, ge=3)
    clean: bool = False
    turns: tuple[int, int] | None = None
    error_model: str = ""
    peak: float | None = Field(None, gt=0)
    stream: str | None = None
    topic: str | None = None

    def run(
        self,
        source: Path,
        cloud: Path,
        returns: Path,
        truth: Path | None = None,
        about: tuple[Path, ...] = (),
    ) -> dict[str, Any]:
        """Write the cloud, its returns and, if `truth` is set, the true points.

        `source` is a recording, or a Parquet table of a scan (whole turns) or of a recording's
        firings. The true points of a recording are its measured points.
        """
        from puckbench.jobs.preparation import prepare

        measured, true, described = self._read(source)
        points = measured.points()
        if len(points) == 0:
            raise InputError(f"{source}: contains no returns")
        model = {"error_model": self.error_model} if self.error_model else {}
        described = {**names_and_groups(cloud, about), **described, **model, **_timing(measured)}
        described |= {"peak": self.peak} if self.peak else {}
        prepared = prepare(PointCloud(points, about=described), 0, self.neighbours)
        if "origin" in described:
            prepared.about["offset"] = described["origin"]
        write_firings(returns, measured)
        write_cloud(cloud, prepared)
        if truth:
            kept = {key: prepared.about[key] for key in ("scale", "offset", "size", "peak")}
            write_cloud(truth, replace(true or prepared, about=kept))
        return {**prepared.about, "points": len(prepared)}

    def _read(self, path: Path) -> tuple[Returns, PointCloud | None, dict[str, Any]]:
        if ScanTable.schema.metadata_key.encode() in parquet_metadata(path):
            with naming(path):
                _check_selection(path, self.stream, self.topic)
                return self._read_scan(path)
        returns, left_out = read_selected_turns(path, self.turns, self.stream, self.topic)
        return returns, None, {"source": path.name, "sensor": returns.sensor, **left_out}

    def _read_scan(self, path: Path) -> tuple[Returns, PointCloud, dict[str, Any]]:
        from puckbench.lidar.scan_returns import returns_of_scan, true_points
        from puckbench.lidar.scan_table import read_scan
        from puckbench.metrics.sensor_metrics import entropy_bits

        table = read_scan(path)
        if self.turns:
            frames = table["frame"]
            table = table.select((frames >= self.turns[0]) & (frames <= self.turns[1]))
        scan = returns_of_scan(table, self.clean)
        selected = _selected(scan.returns, self.turns)
        rows = table.select(scan.rows)
        noise = rows["distance_noisy"] - rows["distance"]
        lasers = rows["frame"] * selected.beams.lasers + rows["laser_id"]
        description = {
            "source": path.name,
            "sensor": selected.sensor,
            "errors": table.about.get("errors", {}),
            "noise_bits": 0.0
            if self.clean
            else entropy_bits(
                noise, lasers, selected.quantum_m, (rows["incidence"], rows["distance"])
            ),
        }
        true = PointCloud(true_points(table, scan))
        if scan.still_at is not None:  # a moving sensor's frame rotates, the normals do not
            description["origin"] = scan.still_at.tolist()
            true = replace(true, normals=rows.normals, labels=rows.primitive_id)
        return selected, true, description


def is_recording(path: Path) -> bool:
    """Whether a file is a recording, by its name or its first bytes."""
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
    """Read turns of a recording or of a table of firings, and counts of damaged data.

    `turns`, `stream` and `topic` are those of `PrepareReturns`.
    """
    from puckbench.lidar.recordings.reading import read_turns

    with naming(path):
        _check_selection(path, stream, topic)
        if not is_recording(path):
            return _selected(read_firings(path), turns), {}
        with decompressed(path) as recording:
            returns, whole, left_out = read_turns(recording, 0.0, stream, path, topic)
        first = whole[0] if whole else min(1, len(returns.turns) - 1)
        selected = _selected(returns, turns or (first, first))
    taken = range(first, first + 1) if turns is None else range(turns[0], turns[1] + 1)
    if not whole:
        _log.warning("%s: has no whole turn: takes a part of one", path)
    elif cut := [number for number in taken if number not in whole]:
        of_whole = f"whole turns are {whole[0]} to {whole[-1]}"
        _log.warning("%s: takes turn %d, which is cut off: %s", path, cut[0], of_whole)
    return selected, left_out


def _selected(returns: Returns, turns: tuple[int, int] | None) -> Returns:
    first, last = turns or (0, len(returns.turns) - 1)
    if not 0 <= first <= last < len(returns.turns):
        most = len(returns.turns) - 1
        raise InputError(f"has turns 0 to {most}, not {first} to {last}")
    return replace(returns, turns=returns.turns[first : last + 1])


def _timing(returns: Returns) -> dict[str, Any]:
    seconds = returns.seconds
    return {
        "turns": len(returns.turns),
        "firings": returns.firings,
        **({} if seconds is None else {"seconds": seconds}),
    }
