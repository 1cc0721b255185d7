"""nuScenes (Caesar 2020): sweeps of a real HDL-32E on a car, with the ring of each point.

References
----------
H. Caesar and others, "nuScenes: A multimodal dataset for autonomous driving", CVPR 2020 (20 Hz, 32
beams, motion compensation). The development kit, `LidarPointCloud.from_file`: float32 x, y, z,
intensity and ring index; its images of the sensors' frames: x right, y forward, z up. That all
firings are there, those without return at the sensor's place, is what sweeps show.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import PositiveInt

from puckbench.core.errors import InputError, naming
from puckbench.core.files import read_bytes
from puckbench.datasets.base import FolderSet, Provenance
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene, safe_name
from puckbench.geometry.cloud import Floats, PointCloud, check_points
from puckbench.geometry.missing_returns import missing_firings
from puckbench.io.clouds import without_invalid, without_missing
from puckbench.io.float32_frames import check_column_count, float32_rows

if TYPE_CHECKING:
    from puckbench.lidar.recordings.rings import RecoveredReturns

_EXPECTED = (
    "nuScenes should lie there, with samples/LIDAR_TOP or sweeps/LIDAR_TOP in it; registration at "
    "nuscenes.org"
)
_SUFFIX = ".pcd.bin"
_NUMBERS, _RINGS = 5, 32


@LOADERS.register("nuscenes")
class NuScenes(FolderSet):
    """Sweeps ``<log>__LIDAR_TOP__<time>.pcd.bin``, in metres, the sensor at the origin.

    Scenes are called samples_<log>_<time> and grouped by log. With `returns` a sweep is the turn
    that its sensor measured, by the rings of the file: the correction of the car's motion is
    undone, as firings without a return tell it. Points follow to some millimetres from laser,
    azimuth and range in steps of 2 mm.
    """

    of_clouds: ClassVar[bool] = True
    provenance = Provenance(
        "CC BY-NC-SA 4.0",
        'H. Caesar et al., "nuScenes: A multimodal dataset for autonomous driving", CVPR 2020',
        _EXPECTED,
    )

    part: Literal["samples", "sweeps"] = "samples"
    """Key frames (samples), or the sweeps between them."""
    every: PositiveInt = 1
    """Step between the sweeps that are used, as neighbouring ones are nearly alike."""
    returns: bool = False
    """Whether sweeps are the sensor's returns, recovered from its points (clouds in metres)."""
    keep_missing: bool = False
    """Whether points that stand for firings without a return, near the sensor, are kept."""

    @property
    def of_returns(self) -> bool:
        """Whether scenes are a sensor's returns."""
        return self.returns

    def load(self, name: str) -> Scene:
        """Read the sweep; `about` has the numbers of points that were left out."""
        path = self._file(name)
        data = read_bytes(path)
        check_column_count(path, data, _NUMBERS)
        table = float32_rows(data, _NUMBERS, path).astype(np.float64)
        log = name.removeprefix(f"{self.part}_").rpartition("_")[0]
        about = self._about(f"nuScenes {self.part}/{path.name}")
        if self.returns:
            with naming(path):
                found = _recovered(table)
            about |= {"sensor": found.returns.sensor, **found.about()}
            return Scene(name, log, returns=found.returns, about=about)
        cloud = PointCloud(table[:, :3], about={**about, "dropped_points": 0})
        if not self.keep_missing:
            missing = missing_firings(cloud.xyz, table[:, 4])
            cloud = without_missing(cloud, missing, path)
        cloud = without_invalid(cloud, path)
        check_points(cloud.xyz, str(path))
        about = cloud.about
        return Scene(name, log, cloud=cloud, origin=(0.0, 0.0, 0.0), about=about)

    def _listed(self, folder: Path) -> Mapping[str, Path]:
        held = sorted((folder / self.part / "LIDAR_TOP").glob(f"*{_SUFFIX}"))
        files = [path for path in held if not path.name.startswith(".")][:: self.every]
        if not files:
            raise self._missing(f"sweeps ({self.part}/LIDAR_TOP/*{_SUFFIX})")
        return {f"{self.part}_{_name(path)}": path for path in files}


def _name(path: Path) -> str:
    """Log and time of a sweep's file."""
    return safe_name(path.name.removesuffix(_SUFFIX).replace("__LIDAR_TOP__", "_"))


def _recovered(table: Floats) -> RecoveredReturns:
    """The returns of a file's rows (n, 5)."""
    from puckbench.lidar.recordings.rings import recovered_firings

    rings = table[:, 4]
    whole = len(rings) > 0 and len(rings) % _RINGS == 0 and bool(np.isfinite(table).all())
    if not whole or (rings.reshape(-1, _RINGS) != np.arange(_RINGS)).any():
        raise InputError(
            f"not {_RINGS} rings in order again and again, from which returns can be recovered"
        )
    return recovered_firings(table[:, :3].reshape(-1, _RINGS, 3), "HDL-32E")
