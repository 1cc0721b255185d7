"""nuScenes (Caesar 2020): frames of an HDL-32E on a car, with the laser (ring) of each point.

References
----------
H. Caesar et al., "nuScenes: A multimodal dataset for autonomous driving", CVPR 2020 (20 Hz, 32
beams, motion compensation). Development kit, `LidarPointCloud.from_file`: float32 x (right), y
(forward), z (up), intensity and ring. Files contain all firings; those without a return have the
sensor's position.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from cloud_files.clouds import without_invalid, without_missing
from cloud_files.float32_frames import check_column_count, float32_rows
from cloud_files.missing_returns import missing_firings
from pointkit.errors import InputError, naming
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats, UncheckedCloud, check_points
from puckbench.scene_sets.frames import FrameSet
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name

if TYPE_CHECKING:
    from puck.recordings.rings import RecoveredReturns

CODE = ("cloud_files.float32_frames", "puckbench.scene_sets.frames", "puck.recordings.rings")

_SUFFIX = ".pcd.bin"
_NUMBERS, _RINGS = 5, 32


@LOADERS.register("nuscenes")
class NuScenes(FrameSet):
    """The scenes are LiDAR frames in files ``<drive>__LIDAR_TOP__<time>.pcd.bin``, in metres.

    The sensor is at (0, 0, 0). Scenes are named samples_<drive>_<time> and grouped by drive. The
    option `returns` converts each frame to the sensor's returns: laser, azimuth, and range in steps
    of 2 mm. They reproduce the points to a few millimetres. The published frames are compensated
    for the car's motion. Firings without a return contain the sensor's positions, by which the
    compensation is undone.
    """

    licence = "CC BY-NC-SA 4.0"
    credit = 'H. Caesar et al., "nuScenes: A multimodal dataset for autonomous driving", CVPR 2020'
    expected = (
        "expected nuScenes, with samples/LIDAR_TOP or sweeps/LIDAR_TOP; registration at "
        "nuscenes.org"
    )

    part: Literal["samples", "sweeps"] = "samples"
    """Key frames (samples), or the sweeps between them."""

    def load(self, name: str) -> Scene:
        path = self.file_of(name)
        data = read_bytes(path)
        check_column_count(path, data, _NUMBERS)
        table = float32_rows(data, _NUMBERS, path).astype(np.float64)
        log = name.removeprefix(f"{self.part}_").rpartition("_")[0]
        about = self.about(f"nuScenes {self.part}/{path.name}")
        if self.returns:
            with naming(path):
                recovered = _recovered(table)
            about |= {"sensor": recovered.returns.sensor, **recovered.about()}
            return Scene(name, log, returns=recovered.returns, about=about)
        cloud = UncheckedCloud(table[:, :3], about={**about, "dropped_points": 0})
        if not self.keep_missing:
            cloud = without_missing(cloud, missing_firings(cloud.xyz, table[:, 4]), path)
        cloud = without_invalid(cloud, path)
        check_points(cloud.xyz, str(path))
        return Scene(name, log, cloud=cloud.checked(), origin=(0.0, 0.0, 0.0), about=cloud.about)

    def listed(self, folder: Path) -> Mapping[str, Path]:
        paths = sorted((folder / self.part / "LIDAR_TOP").glob(f"*{_SUFFIX}"))
        files = [path for path in paths if not path.name.startswith(".")][:: self.every]
        if not files:
            raise self.missing(f"sweeps ({self.part}/LIDAR_TOP/*{_SUFFIX})")
        return {f"{self.part}_{_name(path)}": path for path in files}


def _name(path: Path) -> str:
    return safe_name(path.name.removesuffix(_SUFFIX).replace("__LIDAR_TOP__", "_"))


def _recovered(table: Floats) -> RecoveredReturns:
    from puck.recordings.rings import recovered_firings

    rings = table[:, 4]
    whole = len(rings) > 0 and len(rings) % _RINGS == 0 and bool(np.isfinite(table).all())
    if not whole or (rings.reshape(-1, _RINGS) != np.arange(_RINGS)).any():
        order = f"the order of {_RINGS} rings, from which returns can be recovered"
        raise InputError(f"points are not in {order}")
    return recovered_firings(table[:, :3].reshape(-1, _RINGS, 3), "HDL-32E")
