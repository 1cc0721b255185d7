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
    """The true surface of a scene, prepared so that many decoded clouds can be compared with it.

    Distances from the surface to a decoded cloud start at the visible points. These are `clean` if
    given, else `seen`, else the points of `surface`. If `surface` is a mesh, they are random
    samples of it.

    Parameters
    ----------
    reference
        The original cloud, which defines the coordinates of decoded points.
    surface
        The true surface: a mesh in metres, or points in the coordinates of `reference`.
    seen
        Points of the surface that the sensor saw.
    clean
        The scan without noise: the exact intersections of its rays with the surface.
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
        """Return the errors of decoded points against the true surface.

        Parameters
        ----------
        decoded
            Points (m, 3) in the coordinates of the reference.

        Returns
        -------
        dict
            Values of `truth_distortion` in units of the reference, and the same values in metres.
        """
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
    """Return the errors between the true surface (A) and a decoded cloud (B).

    From A to B, distances start at the visible points. From B to A, they end at the closest point
    of the mesh or, without a mesh, at the nearest visible point. Point-to-plane errors to a mesh
    are those along the mesh's normal at the closest point.

    Parameters
    ----------
    visible
        Points with true normals, on the part of the surface that the sensor saw.
    mesh
        The true surface in the coordinates of `decoded`, if it is known as a mesh.
    decoded
        Points (m, 3) of the decoded cloud.
    is_scan
        Whether `visible` is the scan without noise: the exact intersections of rays and surface.

    Returns
    -------
    dict
        The values of `puckbench.metrics.geometry.distortion`, with the prefix ``truth_``. If
        `is_scan`, the distortion between both clouds of points is added with the prefix ``clean_``.
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
