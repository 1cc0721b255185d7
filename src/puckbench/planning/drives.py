from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pointkit.errors import InputError, among, naming
from pointkit.lidar.sensors import load_sensor
from puckbench.codecs.base import CloudKind
from puckbench.codecs.budget import MOST_PROBES
from puckbench.codecs.coding import skip_anywhere
from puckbench.codecs.rates import (
    budget_of,
    budgets_among,
    find_rate,
    is_length,
    parameters_of,
    rates_of,
)
from puckbench.metrics.task_registry import checked_task
from puckbench.planning.coding_costs import CodingCosts
from puckbench.planning.config import DriveConfig
from puckbench.planning.plan import Plan, SceneSetPlan
from puckbench.planning.scene_checks import refuse_paths
from puckbench.tables.registry import UNDECODED
from virtual_lidar import open_error_model, open_sweep

_CODING_S, _TASK_S = 0.25, 0.06
"""Estimated times (s) to code a turn at one rate, and to measure the tasks on a turn.

A turn is the points of one revolution of the sensor.
"""


@dataclass(frozen=True)
class DrivePlan:
    """The drives of one entry under ``drives`` in the configuration.

    A drive is a sequence of turns of a moving sensor; a turn is one revolution.

    Parameters
    ----------
    name, settings
        Name of the entry, and the entry itself.
    scenes
        The scene set of the entry.
    scans
        For each drive of the virtual sensor, the name of its scene and the seed of the errors.
    clouds
        For each recorded drive, the names of its clouds in the order of time, one for each turn.
    rates
        For each codec, the names of the rates at which the turns are encoded.
    """

    name: str
    settings: DriveConfig
    scenes: SceneSetPlan
    scans: Mapping[str, tuple[str, int]]
    clouds: Mapping[str, tuple[str, ...]]
    rates: Mapping[str, tuple[str, ...]]

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of the drives."""
        return tuple(self.scans or self.clouds)


class Drives:
    """The drives of a run, i.e. sequences of turns, with the codecs that code them.

    Parameters
    ----------
    plan
        The plan of the run.
    costs
        What jobs that run codecs request.

    Raises
    ------
    InputError
        An entry under ``drives`` in the configuration is invalid.
    """

    def __init__(self, plan: Plan, costs: CodingCosts) -> None:
        self.plan, self.costs = plan, costs
        entries = {name: self._entry(name, value) for name, value in plan.drives.items()}
        self.entries = {name: entry for name, entry in entries.items() if entry.drives}

    @property
    def virtual(self) -> list[str]:
        """Names of the entries whose drives are scanned by the virtual sensor."""
        return [name for name, entry in self.entries.items() if entry.settings.is_scan]

    @property
    def real(self) -> list[str]:
        """Names of the entries whose drives are recorded clouds."""
        return [name for name in self.entries if name not in self.virtual]

    @cached_property
    def curves(self) -> tuple[tuple[str, str, str], ...]:
        """The coded drives, as triples (entry, drive, codec)."""
        failed = self.plan.has_failed
        return tuple(
            (name, drive, codec)
            for name, entry in self.entries.items()
            for drive in entry.drives
            for codec in entry.rates
            if not failed("coded_drives", name, drive, codec)
            and not failed("drive_tasks", name, drive, codec)
        )

    @cached_property
    def rows(self) -> tuple[str, ...]:
        """Return the paths of the files with result rows, relative to the results folder.

        There is a file for each drive that was not coded, then one for each of `curves`.
        """
        drives = [(n, drive, UNDECODED) for n, e in self.entries.items() for drive in e.drives]
        undecoded = [row for row in drives if not self.plan.has_failed("drive_tasks", *row)]
        return tuple(f"drive_tasks/{'/'.join(each)}.parquet" for each in (*undecoded, *self.curves))

    def artefacts(self) -> list[str]:
        """Return the files with the streams of drives, relative to the results folder."""
        return [f"coded_drives/{'/'.join(curve)}.zip" for curve in self.curves]

    def request(self, name: str, codec: str) -> dict[str, int]:
        """Return the memory (MB) and time (minutes) of a job that codes a drive, by keyword.

        `name` is the drive's entry in the configuration.
        """
        rates = max(map(len, self.entries[name].rates.values()), default=1)
        opened, own = self.plan.opened[codec], self.entries[name].rates[codec]
        probes = MOST_PROBES if any(budget_of(opened, rate) for rate in own) else 1
        minutes = 10 + int(5 * rates * probes)
        return {"memory_mb": 2 * self.costs.memory_mb(codec), "minutes": minutes}

    def coding_entry(self, name: str, codec: str) -> dict[str, Any]:
        """Return a codec's complete entry, with only the rates at which drives are coded.

        `name` is the drive's entry in the configuration.
        """
        opened, rates = self.plan.opened[codec], self.entries[name].rates[codec]
        budgets = {rate: budget_of(opened, rate) for rate in rates}
        parameters = {
            rate: dict(budget.parameters if budget else parameters_of(opened, rate))
            for rate, budget in budgets.items()
        }
        return self.plan.entry_with(codec, parameters)

    # ---- entries of the configuration

    def _entry(self, name: str, value: DriveConfig) -> DrivePlan:
        where, failed = f"drives.{name}", self.plan.has_failed
        scenes = self.plan.checked_scenes(where, value)
        with naming(where):
            for task, options in value.tasks.items():
                checked_task(task, options)
            for scene in value.trajectories or ("",):
                _check_sweep(value.of_scene(scene))
            refuse_paths(file for scene in scenes.chosen for file in scenes.files(scene))
            refuse_paths(filter(None, [value.poses]))
            scans, clouds = {}, {}
            if value.is_scan:
                driven = _driven(value, scenes)
                scans = {f"{s}-{seed}": (s, seed) for s in driven for seed in value.seeds}
            else:
                clouds = consecutive(scenes.chosen)
                if value.poses and len(clouds) > 1:
                    raise InputError(f"poses: one file, and {len(clouds)} drives")
            return DrivePlan(
                name,
                value,
                scenes,
                scans={
                    drive: source
                    for drive, source in scans.items()
                    if not failed("scenes", scenes.name, source[0])
                    and not failed("drives", name, drive)
                },
                clouds={k: v for k, v in clouds.items() if not failed("drives", name, k)},
                rates=self._rates(value, scenes),
            )

    def _rates(self, value: DriveConfig, scenes: SceneSetPlan) -> dict[str, tuple[str, ...]]:
        returns = value.is_scan or scenes.scenes.of_returns
        kind = CloudKind("metric", returns, returns and scenes.scenes.of_packets)
        rates = {}
        for codec in value.codecs or self.plan.codecs:
            opened = self.plan.opened[codec]
            metric_rates = rates_of(opened, "metric")
            requested = [item for rate in value.rates if (item := find_rate(opened, rate))]
            lengths = tuple(rate for rate, _ in requested if is_length(opened, rate))
            named = budgets_among(opened, value.rates) or lengths if metric_rates else ()
            coded = [r for r in named or metric_rates if not skip_anywhere(opened, kind, r)]
            if coded:
                rates[codec] = tuple(coded)
        return rates


def _driven(value: DriveConfig, scenes: SceneSetPlan) -> tuple[str, ...]:
    for scene in value.trajectories:
        if scene not in scenes.chosen:
            choices = among(scene, scenes.chosen)
            raise InputError(f"trajectories: no scene '{scene}' in {scenes.name}{choices}")
    return tuple(value.trajectories) or scenes.chosen


def _check_sweep(value: DriveConfig) -> None:
    if value.is_scan:
        open_error_model(value.errors, value.error_options)
        sensor, sweep = load_sensor(value.sensor), open_sweep(value.sweep)
        if sweep.trajectory is None or len(sweep.trajectory) < 2:
            raise InputError("sweep: needs a trajectory, along which the sensor moves")
        if sweep.frames < 2 or sweep.turning_hz(sensor) != sweep.frames_per_second:
            turns = f"{sweep.frames} frames, {sweep.turning_hz(sensor):g} turns a second"
            raise InputError(f"sweep: {turns}: a drive has two frames or more, each one turn")


def consecutive(names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Group names of clouds into drives, i.e. sequences of consecutive turns.

    Parameters
    ----------
    names
        Names of clouds, such as ``park_0001``. Clouds with the same text before the last
        underscore belong to one drive.

    Returns
    -------
    dict[str, tuple[str, ...]]
        For each drive, named by this text, its clouds ordered by their numbers.

    Raises
    ------
    InputError
        A name does not end in an underscore and a number, a drive has only one cloud, or the
        numbers of a drive do not have equal steps.
    """
    drives: dict[str, list[str]] = {}
    for name in names:
        part, _, number = name.rpartition("_")
        if not number.isdecimal():
            raise InputError(f"cloud {name}: its name does not end in _NUMBER")
        drives.setdefault(part or "drive", []).append(name)
    for part, clouds in drives.items():
        clouds.sort(key=lambda name: int(name.rpartition("_")[2]))
        if len(clouds) < 2:
            raise InputError(f"drive {part}: a single turn; a drive has at least two")
        numbers = [int(name.rpartition("_")[2]) for name in clouds]
        steps = [after - before for before, after in itertools.pairwise(numbers)]
        for place, step in enumerate(steps):
            if step != min(steps):
                missing = f"between {clouds[place]} and {clouds[place + 1]}"
                raise InputError(f"drive {part}: a gap {missing}: select those that follow")
    return {part: tuple(clouds) for part, clouds in drives.items()}
