from __future__ import annotations

from dataclasses import replace

import numpy as np

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.geometry.mesh import Mesh
from pointkit.seeding import generator
from puckbench.geometry.closest import SearchableMesh, closest_surface_points, mesh_in_frame
from puckbench.geometry.sampling import sample_surface
from puckbench.metrics.geometry import (
    DistinctPoints,
    ReferenceCloud,
    SquaredErrors,
    squared_errors,
    summarise_errors,
)
from puckbench.metrics.units import distortion_in_metres

CODE = ("puckbench.geometry.closest", "puckbench.metrics.coordinate_frames")


class Truth:
    """The true surface of a cloud, with search indices.

    `surface` is a mesh in metres, or points in the reference's coordinates. Visible points are
    `clean` (noise-free points of the scan's rays) if given, else `seen`, else `surface`, sampled if
    it is a mesh.
    """

    def __init__(
        self,
        reference: PointCloud,
        surface: Mesh | PointCloud | None,
        seen: PointCloud | None = None,
        clean: PointCloud | None = None,
    ) -> None:
        about = reference.about
        self._scale = about.get("scale", 1.0)
        self._is_scan = clean is not None
        visible = clean or seen
        mesh = None
        if isinstance(surface, PointCloud):
            visible = visible or surface
        elif surface is not None:
            mesh = mesh_in_frame(surface, self._scale, about.get("offset", (0.0, 0.0, 0.0)))
        self._surface = None if mesh is None else SearchableMesh(mesh)
        self._visible = ReferenceCloud(visible or _sampled(mesh, len(reference)))

    def metrics(self, decoded: Floats | DistinctPoints) -> dict[str, float]:
        """Return the distortion of decoded points (m, 3), in the reference's unit and in metres."""
        distances = truth_distortion(self._visible, self._surface, decoded, self._is_scan)
        return {**distances, **distortion_in_metres(distances, self._scale)}


def _sampled(mesh: Mesh | None, points: int) -> PointCloud:
    assert mesh is not None  # noqa: S101 (there is a surface, and it is no cloud)
    return sample_surface(mesh, points, generator(0, "evaluate", "truth"))


def truth_distortion(
    visible: PointCloud | ReferenceCloud,
    mesh: Mesh | SearchableMesh | None,
    decoded: Floats | DistinctPoints,
    is_scan: bool = False,
) -> dict[str, float]:
    """Return the `distortion` between true surface (A) and decoded cloud (B), as ``truth_...``.

    * A to B: from `visible`, points with true normals on the part that the sensor saw.
    * B to A: to the closest point of the mesh (point-to-plane: along the mesh's normal there) or,
      without a mesh, to the visible points.

    With `is_scan`, the visible points are the clean scan, the intersections of rays and surface;
    the distortion from them is added as ``clean_...``.
    """
    errors = squared_errors(visible, decoded)
    measured = errors if mesh is None else _to_mesh(errors, mesh)
    truth = {f"truth_{key}": value for key, value in summarise_errors(measured).items()}
    if not is_scan:
        return truth
    clean = {f"clean_{key}": value for key, value in summarise_errors(errors).items()}
    del clean["clean_points_a"], clean["clean_points_b"]
    return {**clean, **truth}


def _to_mesh(errors: SquaredErrors, mesh: Mesh | SearchableMesh) -> SquaredErrors:
    surface = closest_surface_points(mesh, errors.decoded)
    offset = errors.decoded - surface.xyz
    along_normal = np.einsum("ij,ij->i", offset, surface.normals)
    return replace(
        errors,
        ba_point=np.einsum("ij,ij->i", offset, offset),
        ba_plane=None if errors.ba_plane is None else along_normal**2,
    )
