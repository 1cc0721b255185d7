from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cloud_files.clouds import write_cloud
from pointkit.column_tables import is_table_of
from pointkit.errors import InputError, naming
from pointkit.files import read_object
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns, read_firings, write_firings
from puckbench.geometry.labels import OF_SCENE, SceneClasses, described_classes, scene_classes
from puckbench.scene_sets.selected_turns import select_turns
from puckbench.steps.prepare import NormalSettings, names_and_groups
from puckbench.steps.step import STEPS, PlannedStep, Step, planned
from virtual_lidar.scan_table import ScanTable

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *("puckbench.steps.prepare", "puckbench.metrics.sensor_metrics", "puckbench.geometry.labels"),
    "puckbench.scene_sets.selected_turns",
    *("virtual_lidar.scan_returns", "virtual_lidar.sweep", "virtual_lidar.trajectory"),
)


@STEPS.register("prepare_returns")
class PrepareReturns(NormalSettings, Step):
    """Prepare a spinning sensor's returns for coding, as a cloud in metres with normals.

    The cloud is in the coordinate frame of the sensor.

    Parameters
    ----------
    error_model
        Name of the error model of a virtual scan, for the description of the cloud.
    """

    error_model: str = ""

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str) -> PlannedStep:
        settings, files = flow.plan.datasets[dataset].settings, flow.files
        model = settings.errors if settings.is_scan else ""
        return planned(
            cls(neighbours=settings.neighbours, error_model=model),
            files.sources(dataset, cloud),
            also=f"{settings.make} {settings.scene_set}",
            memory_mb=files.memory_mb(dataset),
        )

    def run(
        self, source: Path, about: Path, cloud: Path, returns: Path, truth: Path
    ) -> dict[str, Any]:
        """Write the cloud and its returns, and return the description of the cloud.

        Parameters
        ----------
        source
            Parquet table of a virtual scan (of whole turns), or of the firings of a recording.
        about
            Description of the scene (JSON), from which its name and group are copied. The semantic
            classes of its objects become the labels of the points.
        cloud, returns
            Files to write: the cloud, and the table of its firings (Parquet).
        truth
            File to which the true points are written. For a recording, these are the measured
            points.
        """
        measured = read_measured_returns(source).with_classes(scene_classes(read_object(about)))
        return self.write(source, measured, names_and_groups(cloud, about), cloud, returns, truth)

    def write(
        self,
        source: Path,
        measured: MeasuredReturns,
        names: dict[str, Any],
        cloud: Path,
        returns: Path,
        truth: Path | None = None,
        more: dict[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Write measured returns of the file `source` as `run` does.

        Parameters
        ----------
        source
            File of the returns, for error messages.
        measured
            The returns.
        names
            Result of `puckbench.steps.prepare.names_and_groups`.
        cloud, returns, truth
            Files to write; the last is optional.
        more
            Further entries of the description of the cloud.
        """
        from puckbench.steps.preparation import prepare

        points = measured.returns.points()
        if len(points) == 0:
            raise InputError(f"{source}: contains no returns")
        model = {"error_model": self.error_model} if self.error_model else {}
        described = {**names, **measured.about, **model, **_timing(measured.returns)}
        described |= more or {}
        points_of_returns = PointCloud(points, labels=measured.labels, about=described)
        prepared = prepare(points_of_returns, 0, self.neighbours)
        if "origin" in described:
            prepared.about["offset"] = described["origin"]
        write_firings(returns, measured.returns)
        write_cloud(cloud, prepared)
        if truth:
            kept = {key: prepared.about[key] for key in ("scale", "offset", "size", "peak")}
            write_cloud(truth, replace(measured.true or prepared, about=kept))
        return {**prepared.about, "points": len(prepared)}


class MeasuredReturns(NamedTuple):
    """A sensor's returns, the true points if they are known, and a description of both.

    `objects` (n,) are the numbers of the scene's objects at the true points, and `labels` (n,)
    their classes.
    """

    returns: Returns
    true: PointCloud | None
    about: dict[str, Any]
    objects: NDArray[np.int32] | None = None
    labels: NDArray[np.int32] | None = None

    def with_classes(self, classes: SceneClasses | None) -> MeasuredReturns:
        """Return the same with the classes of the returns' objects, if they are known."""
        if classes is None or self.objects is None:
            return self
        about = {**self.about, **described_classes(classes.names, OF_SCENE)}
        return self._replace(about=about, labels=classes.of(self.objects))


def read_measured_returns(
    path: Path, turns: tuple[int, int] | None = None, clean: bool = False
) -> MeasuredReturns:
    """Read the returns in a table of a virtual scan, or in a table of a recording's firings.

    Parameters
    ----------
    path
        The table (Parquet).
    turns
        Numbers, from 0, of the first and last turn (revolution) to read; None reads all.
    clean
        Whether to take the returns of a virtual scan without the sensor's errors.
    """
    with naming(path):
        if is_table_of(path, ScanTable):
            return _of_scan(path, turns, clean)
        returns = select_turns(read_firings(path), turns)
    return MeasuredReturns(returns, None, {"source": path.name, "sensor": returns.sensor})


def _of_scan(path: Path, turns: tuple[int, int] | None, clean: bool) -> MeasuredReturns:
    from puckbench.metrics.sensor_metrics import entropy_bits
    from virtual_lidar.scan_returns import returns_of_scan, true_points
    from virtual_lidar.scan_table import read_scan

    table = read_scan(path)
    if turns:
        frames = table["frame"]
        table = table.select((frames >= turns[0]) & (frames <= turns[1]))
    scan = returns_of_scan(table, clean)
    selected = select_turns(scan.returns, turns)
    rows = table.select(scan.rows)
    noise = rows["distance_noisy"] - rows["distance"]
    lasers = rows["frame"] * selected.beams.lasers + rows["laser_id"]
    conditions = (rows["incidence"], rows["distance"])
    bits = 0.0 if clean else entropy_bits(noise, lasers, selected.quantum_m, conditions)
    about = {
        "source": path.name,
        "sensor": selected.sensor,
        "errors": table.about.get("errors", {}),
        "noise_bits": bits,
    }
    true = PointCloud(true_points(table, scan))
    if scan.still_at is not None:  # a moving sensor's frame rotates, the normals do not
        about["origin"] = scan.still_at.tolist()
        true = replace(true, normals=rows.normals, labels=rows.primitive_id)
    return MeasuredReturns(selected, true, about, rows.object_id)


def _timing(returns: Returns) -> dict[str, Any]:
    seconds = returns.seconds
    return {
        "turns": len(returns.turns),
        "firings": returns.firings,
        **({} if seconds is None else {"seconds": seconds}),
    }
