from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import Field

from cloud_files.clouds import write_cloud
from pointkit.column_tables import is_table_of
from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns, read_firings, write_firings
from puckbench.jobs.prepare import names_and_groups
from puckbench.jobs.registry import JOBS, Job
from virtual_lidar.scan_table import ScanTable

CODE = (
    *("puckbench.jobs.prepare", "puckbench.metrics.sensor_metrics"),
    *("virtual_lidar.scan_returns", "virtual_lidar.sweep", "virtual_lidar.trajectory"),
)


@JOBS.register("prepare_returns")
class PrepareReturns(Job):
    """Prepare a spinning sensor's returns for coding, as a cloud in metres with normals.

    The cloud is in the coordinate frame of the sensor.

    Parameters
    ----------
    neighbours
        Number of neighbouring points from which a normal is estimated.
    clean
        Whether to take the returns of a virtual scan without the sensor's errors.
    turns
        Numbers, from 0, of the first and last turn (revolution) to use; by default all turns.
    error_model
        Name of the error model of a virtual scan, for the description of the cloud.
    peak
        PSNR peak, in m; by default `puckbench.metrics.default_peak.PEAK_M`.
    """

    neighbours: int = Field(30, ge=3)
    clean: bool = False
    turns: tuple[int, int] | None = None
    error_model: str = ""
    peak: float | None = Field(None, gt=0)

    def run(
        self,
        source: Path,
        cloud: Path,
        returns: Path,
        truth: Path | None = None,
        about: tuple[Path, ...] = (),
    ) -> dict[str, Any]:
        """Write the cloud and its returns, and return the description of the cloud.

        Parameters
        ----------
        source
            Parquet table of a virtual scan (of whole turns), or of the firings of a recording.
        cloud, returns
            Files to write: the cloud, and the table of its firings (Parquet).
        truth
            If set, file to which the true points are written. For a recording, these are the
            measured points.
        about
            Descriptions of the scene (JSON), from which its name and group are copied.
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
        with naming(path):
            if is_table_of(path, ScanTable):
                return self._read_scan(path)
            returns = select_turns(read_firings(path), self.turns)
        return returns, None, {"source": path.name, "sensor": returns.sensor}

    def _read_scan(self, path: Path) -> tuple[Returns, PointCloud, dict[str, Any]]:
        from puckbench.metrics.sensor_metrics import entropy_bits
        from virtual_lidar.scan_returns import returns_of_scan, true_points
        from virtual_lidar.scan_table import read_scan

        table = read_scan(path)
        if self.turns:
            frames = table["frame"]
            table = table.select((frames >= self.turns[0]) & (frames <= self.turns[1]))
        scan = returns_of_scan(table, self.clean)
        selected = select_turns(scan.returns, self.turns)
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


def _timing(returns: Returns) -> dict[str, Any]:
    seconds = returns.seconds
    return {
        "turns": len(returns.turns),
        "firings": returns.firings,
        **({} if seconds is None else {"seconds": seconds}),
    }
