from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from pointkit.errors import InputError, naming, noting
from pointkit.files import write_bytes
from pointkit.geometry.cloud import PointCloud, check_points
from pointkit.measurement import measured
from puckbench import __version__
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.core.environment import run_environment
from puckbench.geometry.digest import cloud_digest
from puckbench.metrics.task_registry import TASKS, task_results
from puckbench.recordings.drives import (
    AZIMUTH,
    KEPT,
    NONE,
    Drive,
    read_drive,
    shares_of,
    timed_by_azimuth,
)
from puckbench.results.coded_drives import CodedDrive, read_coded_drive
from puckbench.results.row_files import write_rows
from puckbench.steps.coding import TimedStep, planned_codec_step, ready
from puckbench.steps.step import STEPS, PlannedStep, Step
from puckbench.tables.registry import UNDECODED

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *(*CLOUD_FILES, *CODEC, "cloud_files.poses", "puckbench.geometry.digest"),
    *("puckbench.recordings", "puckbench.results.coded_drives"),
)


class TaskStep(Step):
    """Base class of steps that measure a robot's tasks, such as odometry, on the turns of a drive.

    Tasks use the times at which points were measured during a turn (a revolution of the sensor).
    The column ``times`` of the results tells where these times come from. They are ``kept`` by
    codecs that encode a sensor's returns. Codecs that encode points lose them: the tasks are then
    measured twice, with times that follow from the points' ``azimuth``, and with ``none``. Azimuths
    give times only if the original points have times that follow from azimuths.

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

    def rows(
        self, drive: Drive, turns: Sequence[PointCloud], record: Mapping[str, Any], name: str
    ) -> Iterator[dict[str, Any]]:
        """Yield a row of results for each kind of times that turns can have.

        Values of type bytes are contents of files, which `write_task_results` takes.

        Parameters
        ----------
        drive
            The original drive.
        turns
            Its turns, original or decoded.
        record
            Facts about the turns, such as codec and rate, by name of the column.
        name
            Name of the drive.
        """
        points = np.concatenate([turn.xyz for turn in drive.turns])
        described = {"dataset": self.dataset, "cloud": name, **drive.about}
        described["digest"] = cloud_digest(points, metric=True)
        for times, timed in _with_times(drive, turns):
            row = {
                **record,
                "times": times,
                "turns": len(turns),
                "points_in": drive.points,
                "points_out": sum(map(len, turns)),
                "puckbench_version": __version__,
            }
            yield {**described, **row, **task_results(self.tasks, drive, timed, row)}


@STEPS.register("measure_drive")
class MeasureDrive(TaskStep, TimedStep):
    """Decode a drive at all rates, and measure a robot's tasks on the decoded turns."""

    @classmethod
    def of_plan(cls, flow: Workflow, /, drives: str, drive: str, codec: str) -> PlannedStep:
        tasks = flow.plan.drives[drives].tasks
        entry = flow.drives.coding_entry(drives, codec)
        step = cls(dataset=drives, codec=codec, entry=entry, tasks=tasks, **flow.plan.timing)
        files, request = flow.files, flow.drives.request(drives, codec)
        inputs = {
            "drive": files.drive(drives, drive),
            "curve": files.coded_drive(drives, drive, codec),
        }
        return planned_codec_step(flow, step, inputs, *map(TASKS.module_of, tasks), **request)

    def run(self, drive: Path, curve: Path, rows: Path, trajectories: Path) -> dict[str, Any]:
        """Write a row of results for each rate and kind of times, and the files that tasks make.

        Parameters
        ----------
        drive
            The original drive.
        curve
            The encoded drive.
        rows
            File for the rows (Parquet).
        trajectories
            Folder for the files of tasks, such as ``200mm_azimuth_kiss_icp.tum``: the trajectory
            that KISS-ICP estimates at a rate of 200 mm with times from azimuths.
        """
        original, codec = read_drive(drive), ready(self.opened())
        with naming(curve):
            results = [
                row
                for coded in read_coded_drive(curve).values()
                for row in self.rows(original, *self._decoded(original, codec, coded), drive.stem)
            ]
        write_task_results(rows, trajectories, results)
        return {"rates": len(results)}

    def _decoded(
        self, drive: Drive, codec: Codec, coded: CodedDrive
    ) -> tuple[list[PointCloud], dict[str, Any]]:
        """Return the decoded turns, and the record of the streams with costs of decoding."""
        if len(coded.streams) != len(drive.turns):
            raise InputError(f"{len(coded.streams)} coded turns for a drive of {len(drive.turns)}")
        with noting(f"rate {coded.record.get('rate', '?')}"):
            timed = measured(
                lambda: [decoded(codec, stream) for stream in coded.streams], self.repeats
            )
            for turn in timed.result:
                check_points(turn.xyz, f"codec {codec.name}: decoded points")
        costs = {**timed.costs("decode"), **run_environment(self.exclusive)}
        return timed.result, {**coded.record, **costs}


def write_task_results(
    rows: Path,
    folder: Path,
    results: Iterable[Mapping[str, Any]],
    more: Mapping[str, bytes] | None = None,
) -> None:
    """Write rows of results, and the files that tasks made for each.

    Parameters
    ----------
    rows
        File for the rows (Parquet).
    folder
        Folder for the files; what it contains already is removed. Names of files begin with the
        rate, if turns were coded, and the kind of times.
    results
        Rows. Values of type bytes are contents of files, by the end of the file's name.
    more
        Content of further files, by name.
    """
    table, files = [], dict(more or {})
    for row in results:
        made = {name: value for name, value in row.items() if isinstance(value, bytes)}
        table.append({name: value for name, value in row.items() if name not in made})
        rate = "" if row["codec"] == UNDECODED else f"{row['rate']}_"
        files |= {f"{rate}{row['times']}_{name}": value for name, value in made.items()}
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_bytes(folder / name, content)
    write_rows(rows, table)


def _with_times(
    drive: Drive, turns: Sequence[PointCloud]
) -> Iterator[tuple[str, Sequence[PointCloud]]]:
    """Yield a kind of times and the turns with such times, for each kind that turns can have."""
    if _is_timed(drive, turns):
        yield KEPT, turns
        if turns is not drive.turns:
            return
    if drive.turn_s > 0:
        both = zip(turns, drive.turns, strict=True)
        timed = [timed_by_azimuth(turn, original) for turn, original in both]
        if len(found := [turn for turn in timed if turn is not None]) == len(timed):
            yield AZIMUTH, tuple(found)
    yield NONE, tuple(PointCloud(turn.xyz) for turn in turns)


def _is_timed(drive: Drive, turns: Sequence[PointCloud]) -> bool:
    return drive.turn_s > 0 and all(shares_of(turn) is not None for turn in turns)
