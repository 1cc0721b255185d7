from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from puckbench.core.code import MESH_FILES
from puckbench.scene_sets.loader_code import reader_modules
from puckbench.scene_sets.recordings import decompressed, recording_files
from puckbench.steps.step import STEPS, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow
    from virtual_lidar.walls.residuals import RecordedPlanes, RecordingOptions

CODE = (
    *MESH_FILES,
    "puckbench.scene_sets.recordings",
    "virtual_lidar.residual_table",
    "virtual_lidar.walls.*",
)


@STEPS.register("capture_residuals")
class CaptureResiduals(Step):
    """Find walls, floor and ceiling in a recording, and measure the sensor's range noise on them.

    `options` are those of the measurement, as in the configuration's ``captures``.
    """

    options: dict[str, Any] = Field({})

    @classmethod
    def of_plan(cls, flow: Workflow, /, capture: str) -> PlannedStep:
        path, options = flow.sensor_study.study.captures[capture]
        files = [str(file) for file in recording_files(Path(path))]
        return planned(
            cls(options=options),
            {},
            *reader_modules(files[:1]),
            content={"capture": files[:1], "beside": files[1:]},
            also=flow.plan.digest_of(files),
            memory_mb=2000,
            minutes=20,
        )

    def run(self, capture: Path, table: Path) -> dict[str, Any]:
        """Write the distances of points from their planes to `table`, and return a summary."""
        from pointkit.tables import write_table
        from virtual_lidar.residual_table import REAL
        from virtual_lidar.walls.residuals import recording_options, recording_residuals
        from virtual_lidar.walls.statistics import recording_summary

        options = recording_options(self.options)
        planes = planes_of_capture(capture, options)
        write_table(recording_residuals(planes), table)
        return {"model": REAL, **recording_summary(planes)}


def planes_of_capture(capture: Path, options: RecordingOptions) -> RecordedPlanes:
    """Return the planes that are found in a recording, with the points that lie on them.

    Parameters
    ----------
    capture
        File of the recording, compressed or not.
    options
        Options of the measurement, such as the sensor and the time during which it stood still.
    """
    from pointkit.lidar.sensors import load_sensor
    from puckbench.recordings.reading import read_recording
    from virtual_lidar.walls.residuals import recorded_planes

    sensor = load_sensor(options.sensor) if options.sensor else None
    start, end = options.still_s or (0.0, math.inf)
    of_file = (options.stream, options.time_unit, capture, options.topic)
    with decompressed(capture) as recording:
        table = read_recording(recording, sensor, start, end, *of_file)
    return recorded_planes(table, options, capture)
