"""From virtual scans and recordings to clouds in metres that carry their returns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import Field

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import write_cloud
from puckbench.jobs.prepare import kept_descriptions
from puckbench.jobs.registry import JOBS, Job
from puckbench.lidar.returns import Returns, read_firings, write_firings

PEAK_M = 30.0
"""Of PSNRs of clouds in metres: 30,000 steps of 1 mm, MPEG's for such data."""


@JOBS.register("prepare_returns")
class PrepareReturns(Job):
    """Take a scan's or a recording's returns as a cloud in the sensor's frame, with normals.

    clean: take a scan's true ranges. error_model: name of the scan's, for tables.
    """

    neighbours: int = Field(30, ge=3)
    clean: bool = False
    error_model: str = ""

    def run(
        self,
        source: Path,
        cloud: Path,
        returns: Path,
        truth: Path | None = None,
        about: tuple[Path, ...] = (),
    ) -> dict[str, Any]:
        """Write the cloud, its returns and, if asked for, the true points.

        Parameters
        ----------
        source
            A scan table of whole turns, or a table of firings (both .parquet).
        truth
            Of a scan its true points in the sensor's frame; of a recording the points themselves.
        about
            Descriptions whose name and group are kept.
        """
        from puckbench.jobs.preparation import prepare

        found, true, described = _read(source, self.clean)
        points = found.points()
        if len(points) == 0:
            raise InputError(f"{source}: there is no return")
        named = {"error_model": self.error_model} if self.error_model else {}
        described = {**kept_descriptions(about), **described, **named, **_timing(found)}
        described["peak"] = PEAK_M
        prepared = prepare(PointCloud(points, about=described), 0, self.neighbours)
        if "origin" in described:
            prepared.about["offset"] = described["origin"]
        write_firings(returns, found)
        write_cloud(cloud, prepared)
        if truth:
            kept = {key: prepared.about[key] for key in ("scale", "offset", "size", "peak")}
            write_cloud(truth, replace(true or prepared, about=kept))
        return {**prepared.about, "points": len(prepared)}


def _read(path: Path, clean: bool) -> tuple[Returns, PointCloud | None, dict[str, Any]]:
    """The returns of a file, the true points of a scan, and what is known of them."""
    from puckbench.io.columns import metadata_of
    from puckbench.lidar.scan_returns import returns_of_scan, true_points
    from puckbench.lidar.scan_table import ScanTable, read_scan
    from puckbench.metrics.returns import entropy_bits

    if ScanTable.declared.key.encode() not in metadata_of(path):
        returns = read_firings(path)
        return returns, None, {"source": path.name, "sensor": returns.sensor}
    table = read_scan(path)
    found = returns_of_scan(table, clean)
    known = {"source": path.name, "sensor": found.returns.sensor, "errors": table.about["errors"]}
    rows = table.select(found.rows)
    noise = rows["distance_noisy"] - rows["distance"]
    lasers = rows["frame"] * found.returns.beams.lasers + rows["laser_id"]
    known["noise_bits"] = 0.0 if clean else entropy_bits(noise, lasers, found.returns.quantum_m)
    true = PointCloud(true_points(table, found))
    if found.still_at is not None:  # of a moving sensor the world's normals turn with each step
        known["origin"] = found.still_at.tolist()
        labels = table.primitive_id[found.rows]
        true = replace(true, normals=table.normals[found.rows], labels=labels)
    return found.returns, true, known


def _timing(returns: Returns) -> dict[str, Any]:
    """Turns, firings and how long they took."""
    seconds = returns.seconds
    return {
        "turns": len(returns.turns),
        "firings": returns.firings,
        **({} if seconds is None else {"seconds": seconds}),
    }
