from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.geometry.crop import inside_box
from puckbench.geometry.digest import cloud_digest
from puckbench.geometry.scaling import (
    GRID,
    METRIC,
    Scaling,
    cube_scaling,
    grid_scaling,
    origin_shift,
    without_last_digits,
)
from puckbench.metrics.default_peak import PEAK_M

CODE = (
    *("puckbench.geometry.crop", "puckbench.geometry.digest", "puckbench.geometry.normals"),
    *("puckbench.geometry.scaling", "puckbench.metrics.default_peak", "puckbench.metrics.density"),
    *("puckbench.metrics.diameter", "puckbench.metrics.elongation"),
)


@dataclass(frozen=True)
class MeasuredPoints:
    """Measured points, each with the true point on the surface.

    Parameters
    ----------
    cloud
        The measured points.
    clean
        The true points, in the same order.
    """

    cloud: PointCloud
    clean: PointCloud

    def cropped(self, box: Floats, on: str = "clean") -> MeasuredPoints:
        """Return the points that lie in a box.

        Parameters
        ----------
        box
            Lowest and highest corner (2, 3), m.
        on
            ``clean`` to test the true points, or ``noisy`` to test the measured points.
        """
        cloud = self.clean if on == "clean" else self.cloud
        rows = inside_box(cloud.xyz, box)
        return MeasuredPoints(self.cloud.select(rows), self.clean.select(rows))

    def truth_in_frame_of(self, prepared: PointCloud) -> PointCloud:
        """Return the true points, scaled and shifted like a prepared cloud."""
        about = {key: prepared.about[key] for key in ("scale", "offset", "size")}
        xyz = Scaling(about["scale"], np.asarray(about["offset"])).apply(self.clean.xyz)
        if about["size"]:
            xyz = without_last_digits(xyz)
        return replace(self.clean, xyz=xyz, about=about)


def prepare(cloud: PointCloud, size: int | str = 1024, neighbours: int = 30) -> PointCloud:
    """Return a cloud scaled for coding, with estimated normals (thesis section 6.1).

    The description ``about`` gets scale, offset, elongations, extent, density, outliers, diameter
    and digest. For a cloud that stays in metres, it also gets the PSNR peak.

    Parameters
    ----------
    cloud
        Cloud in metres.
    size
        Number of grid positions along a side of the cube [0, size - 1] to which the cloud is
        scaled, in multiples of 2^-16. With 0 or `METRIC`, the cloud stays in metres, but is shifted
        if coordinates are large (`origin_shift`). With `GRID`, it gets the coordinates of its own
        voxel grid.
    neighbours
        Number of neighbouring points from which a normal is estimated.
    """
    from puckbench.geometry.normals import estimate_normals
    from puckbench.metrics.density import density, density_in_metres
    from puckbench.metrics.diameter import diameter

    scaling, xyz, side = _scaled(cloud, size)
    digest = cloud_digest(xyz, metric=side == 0)
    if side:
        xyz = without_last_digits(xyz)
    about = {
        **cloud.about,
        "scale": float(scaling.scale),
        "offset": scaling.offset.tolist(),
        "size": side,
        "neighbours": neighbours,
        "size_m": np.ptp(cloud.xyz, axis=0).tolist(),
        **_elongations(cloud.xyz),
        **density_in_metres(density(xyz), float(scaling.scale)),
        "diameter": diameter(xyz),
        "digest": digest,
        **({} if side else {"peak": cloud.about.get("peak", PEAK_M)}),
    }
    return replace(cloud, xyz=xyz, normals=estimate_normals(xyz, neighbours), about=about)


def _elongations(points: Floats) -> dict[str, float]:
    from puckbench.metrics.elongation import elongation, oriented_elongation

    local = points - origin_shift(points)  # large coordinates would lose precision
    return {"elongation": elongation(local), "elongation_oriented": oriented_elongation(local)}


def _scaled(cloud: PointCloud, size: int | str) -> tuple[Scaling, Floats, int]:
    if size == GRID:
        scaling = grid_scaling(cloud.xyz, cloud.about)
        return scaling, np.rint(scaling.apply(cloud.xyz)), int(cloud.about["grid"]["size"])
    side = 0 if size == METRIC else int(size)
    scaling = cube_scaling(cloud.xyz, side) if side else Scaling(1.0, origin_shift(cloud.xyz))
    return scaling, scaling.apply(cloud.xyz), side
