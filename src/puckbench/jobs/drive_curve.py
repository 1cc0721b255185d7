from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from pointkit.errors import InputError, naming, noting
from pointkit.files import json_bytes, object_of
from pointkit.geometry.cloud import PointCloud, check_points
from pointkit.measurement import Cost, measured
from pointkit.terminal import Progress
from puckbench import __version__
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded, encoded
from puckbench.codecs.rates import rates_of
from puckbench.codecs.registry import open_codec
from puckbench.core.archives import read_archive, write_archive
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.core.environment import run_environment
from puckbench.geometry.digest import cloud_digest
from puckbench.jobs.codec_jobs import TimedJob, ready
from puckbench.jobs.curve_files import RECORD, STREAM, write_rows
from puckbench.jobs.registry import JOBS
from puckbench.metrics.table_registry import UNDECODED
from puckbench.metrics.task_registry import task_results
from puckbench.recordings.drives import AZIMUTH, KEPT, NONE, Drive, read_drive, timed_by_azimuth

CODE = (
    *(*CLOUD_FILES, *CODEC, "cloud_files.poses", "puckbench.geometry.digest"),
    "puckbench.recordings",
)

_UNDECODED_RATES = {KEPT: "times", AZIMUTH: "azimuth times", NONE: "no times"}


@dataclass(frozen=True)
class CodedDrive:
    """A drive that was encoded at one rate.

    Parameters
    ----------
    streams
        One stream for each turn, i.e. for each revolution of the sensor.
    record
        Facts about the encoding of all turns, such as codec, rate, bytes and seconds.
    """

    streams: tuple[bytes, ...]
    record: Mapping[str, Any]


def write_coded_drive(path: Path, rates: Mapping[str, CodedDrive]) -> None:
    """Write a drive that was encoded at several rates, given by name, to one ZIP file."""
    members: dict[str, bytes] = {}
    for rate, coded in rates.items():
        members[rate + RECORD] = json_bytes(coded.record)
        members |= {f"{rate}/{k:04d}{STREAM}": each for k, each in enumerate(coded.streams)}
    write_archive(path, members)


def read_coded_drive(path: Path) -> dict[str, CodedDrive]:
    """Return an encoded drive by rate; raise InputError if the file is not one."""
    members = read_archive(path)
    rates = {}
    for name, data in members.items():
        if "/" not in name and name.endswith(RECORD):
            rate = name.removesuffix(RECORD)
            streams = tuple(members[key] for key in members if key.startswith(f"{rate}/"))
            rates[rate] = CodedDrive(streams, object_of(data, f"{path}: {name}"))
    if not rates or not all(coded.streams for coded in rates.values()):
        raise InputError(f"{path}: not an archive of coded turns")
    return rates


@JOBS.register("encode_drive")
class EncodeDrive(TimedJob):
    """Encode a drive at all rates that a codec has for clouds in metres.

    A drive is a sequence of turns (revolutions) of a moving sensor. Each turn becomes a separate
    stream.
    """

    codec: str

    def run(self, drive: Path, curve: Path) -> dict[str, Any]:
        """Encode the file `drive`, write all streams to `curve`, and return the number of rates."""
        codec, turns = ready(open_codec(self.codec, self.changes)), read_drive(drive).turns
        points = sum(map(len, turns))
        rates, shared = rates_of(codec, "metric"), [codec.prepare(turn) for turn in turns]
        progress, coded = Progress("rate"), {}
        for done, rate in enumerate(rates, start=1):

            def encoded_turns(rate: str = rate) -> list[bytes]:
                each = zip(turns, shared, strict=True)
                return [encoded(codec, turn, rate, work) for turn, work in each]

            saved = _saved(shared)
            with noting(f"rate {rate}"):
                timed = measured(encoded_turns, self.repeats, saved)
            size = sum(map(len, timed.result))
            record = {
                "codec": self.codec,
                "rate": rate,
                "codec_version": codec.version,
                "bytes": size,
                "bpp": 8 * size / points,
                "repeats": self.repeats,
                **timed.costs("encode"),
            }
            coded[rate] = CodedDrive(tuple(timed.result), record)
            progress(done, len(rates))
        write_coded_drive(curve, coded)
        return {"rates": len(coded)}


def _saved(shared: Sequence[Any]) -> Callable[[Cost], Cost]:
    def whole(here: Cost) -> Cost:
        for work in filter(None, shared):
            here = here.plus(work.saved)
        return here

    return whole


@JOBS.register("measure_drive")
class MeasureDrive(TimedJob):
    """Measure a robot's tasks, such as odometry, on the decoded or the original turns of a drive.

    Tasks use the times at which points were measured during a turn (a revolution of the sensor).
    The column ``times`` of the results tells where these times come from. They are ``kept`` by
    codecs that encode a sensor's returns. Codecs that encode points lose them: the tasks are then
    measured twice, with times that follow from the points' ``azimuth``, and with ``none``. Azimuths
    give times only if the original drive has returns, and the sensor moves during a turn.

    Parameters
    ----------
    dataset
        Name of the entry under ``drives`` in the configuration.
    tasks
        Options of each task, by the name or place (``file.py:function``) of the task.
    """

    dataset: str
    tasks: dict[str, dict[str, Any]] = Field({})

    def plugins(self) -> Iterable[str | None]:
        return *super().plugins(), *self.tasks

    def run(self, drive: Path, rows: Path, curve: Path | None = None) -> dict[str, Any]:
        """Write a row of results for each rate and kind of times to the file `rows` (Parquet).

        `curve` is the encoded drive. Without it, the tasks are measured on the file `drive` itself.
        """
        original = read_drive(drive)
        about = {**original.about, "digest": _digest(original)}
        described = {"dataset": self.dataset, "cloud": drive.stem, **about}
        if curve is None:
            results = list(self._undecoded(original))
        else:
            with naming(curve):
                coded = read_coded_drive(curve)
                results = [row for item in coded.values() for row in self._decoded(original, item)]
        write_rows(rows, [{**described, **row} for row in results])
        return {"rates": len(results)}

    def _undecoded(self, drive: Drive) -> Iterable[dict[str, Any]]:
        if _is_timed(drive, drive.turns):
            kept = {"codec": UNDECODED, "rate": _UNDECODED_RATES[KEPT]}
            yield self._row(drive, drive.turns, kept, KEPT)
        for times, turns in _of_points(drive, drive.turns):
            yield self._row(
                drive, turns, {"codec": UNDECODED, "rate": _UNDECODED_RATES[times]}, times
            )

    def _decoded(self, drive: Drive, coded: CodedDrive) -> Iterable[dict[str, Any]]:
        name, record = str(self.codec), coded.record
        if len(coded.streams) != len(drive.turns):
            raise InputError(f"{len(coded.streams)} coded turns for a drive of {len(drive.turns)}")
        codec: Codec = self.loaded(name)
        with noting(f"rate {record.get('rate', '?')}"):
            timed = measured(
                lambda: [decoded(codec, stream) for stream in coded.streams], self.repeats
            )
            for turn in timed.result:
                check_points(turn.xyz, f"codec {name}: decoded points")
        row = {**record, **timed.costs("decode"), **run_environment(self.alone)}
        if _is_timed(drive, timed.result):
            yield self._row(drive, timed.result, row, KEPT)
            return
        for times, turns in _of_points(drive, timed.result):
            yield self._row(drive, turns, row, times)

    def _row(
        self, drive: Drive, turns: Sequence[PointCloud], record: Mapping[str, Any], times: str
    ) -> dict[str, Any]:
        row = {
            **record,
            "times": times,
            "turns": len(turns),
            "points_in": drive.points,
            "points_out": sum(map(len, turns)),
            "puckbench_version": __version__,
        }
        return {**row, **task_results(self.tasks, drive, turns, row)}


def _is_timed(drive: Drive, turns: Sequence[PointCloud]) -> bool:
    return drive.turn_s > 0 and all(turn.returns is not None for turn in turns)


def _of_points(
    drive: Drive, turns: Sequence[PointCloud]
) -> Iterator[tuple[str, tuple[PointCloud, ...]]]:
    """Yield a kind of times and the turns with such times, for each kind that points can have."""
    if _is_timed(drive, drive.turns):
        both = zip(turns, drive.turns, strict=True)
        yield AZIMUTH, tuple(timed_by_azimuth(turn, original) for turn, original in both)
    yield NONE, tuple(PointCloud(turn.xyz) for turn in turns)


def _digest(drive: Drive) -> str:
    points = np.concatenate([turn.xyz for turn in drive.turns])
    return cloud_digest(points, metric=True)
