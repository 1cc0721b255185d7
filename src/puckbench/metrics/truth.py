"""Distortion against the truth: the surface that was scanned, not the noisy scan of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from puckbench.core.seeding import generator
from puckbench.geometry.closest import SearchableMesh, closest_surface_points, mesh_in_frame
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.mesh import Mesh
from puckbench.geometry.sampling import sample_surface
from puckbench.metrics.geometry import (
    DistinctPoints,
    Reference,
    SquaredErrors,
    squared_errors,
    summary,
)
from puckbench.metrics.units import in_metres


class Truth:
    """The true surface of a cloud, made ready once for all decoded clouds compared with it.

    Parameters
    ----------
    reference
        The cloud that was coded; its description tells the frame.
    surface
        The true surface: a mesh in metres, or points in the reference's frame.
    seen
        Points of the true surface that the cloud's own stand for; drawn on the mesh if not given.
    clean
        The clean scan of the same rays, in place of `seen`.
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
        self._visible = Reference(visible or _sampled(mesh, len(reference)))

    def measures(self, decoded: Floats | DistinctPoints) -> dict[str, float]:
        """Distortion of a decoded cloud (m, 3), in the reference's frame and in metres."""
        measure = scan_distortion if self._is_scan else truth_distortion
        found = measure(self._visible, self._surface, decoded)
        return {**found, **in_metres(found, self._scale)}


def _sampled(mesh: Mesh | None, points: int) -> PointCloud:
    assert mesh is not None  # noqa: S101 (there is a surface, and it is no cloud)
    return sample_surface(mesh, points, generator(0, "evaluate", "truth"))


def truth_distortion(
    visible: PointCloud | Reference,
    mesh: Mesh | SearchableMesh | None,
    decoded: Floats | DistinctPoints,
) -> dict[str, float]:
    """Distortion of a decoded cloud (B) against the true surface (A), not its noisy scan.

    * A to B: from the visible points to the decoded cloud, as in
      `puckbench.metrics.geometry.distortion`.
    * B to A: from each decoded point to the closest point of the mesh, and, to plane, along the
      normal of the triangle there; without a mesh to the visible points, as in `distortion`.

    Parameters
    ----------
    visible
        Points on the part of the true surface that the sensor saw, with the true normals: a codec
        is not charged for surface that no ray reached.
    mesh
        The true surface in the cloud's frame (`puckbench.geometry.closest.mesh_in_frame`); None
        when only points are known.
    decoded
        (m, 3), in the cloud's frame; as in `distortion`.

    Returns
    -------
    dict
        The keys of `distortion` with ``truth_`` before them: ``truth_acd_ab_point`` (truth to
        decoded), ``truth_acd_ba_point`` (decoded to truth), ``truth_cd_point``, ``truth_d1_mse``,
        ``truth_hausdorff_point``, ``truth_hausdorff_sq_point``, the same with ``_plane`` and
        ``truth_d2_mse`` (when `visible` has normals), ``truth_points_a`` (visible points) and
        ``truth_points_b``.

    Raises
    ------
    InputError
        As `distortion`.
    """
    errors = squared_errors(visible, decoded)
    return _to_truth(errors, mesh)


def scan_distortion(
    clean: PointCloud | Reference,
    mesh: Mesh | SearchableMesh | None,
    decoded: Floats | DistinctPoints,
) -> dict[str, float]:
    """`truth_distortion` of a scan, and the same against the clean scan of the same rays.

    Beside the keys of `truth_distortion` it returns those of `distortion` with ``clean_`` before
    them, of which ``clean_acd_ab_point`` and ``clean_acd_ab_plane`` are equal to the truth's: the
    two measures differ in whether decoded points are compared with the surface or with points.

    Parameters
    ----------
    clean
        Where the rays of the scan met the surface, (n, 3), with the true normals; they are also
        the visible points of the surface.
    mesh, decoded
        As in `truth_distortion`.
    """
    errors = squared_errors(clean, decoded)
    to_points = {f"clean_{key}": value for key, value in summary(errors).items()}
    counted = ("clean_points_a", "clean_points_b")
    return {
        **{key: value for key, value in to_points.items() if key not in counted},
        **_to_truth(errors, mesh),
    }


def _to_truth(errors: SquaredErrors, mesh: Mesh | SearchableMesh | None) -> dict[str, float]:
    measured = errors if mesh is None else _to_mesh(errors, mesh)
    return {f"truth_{key}": value for key, value in summary(measured).items()}


def _to_mesh(errors: SquaredErrors, mesh: Mesh | SearchableMesh) -> SquaredErrors:
    """Replace the errors from decoded to truth by those to the mesh."""
    surface = closest_surface_points(mesh, errors.decoded)
    offset = errors.decoded - surface.xyz
    along_normal = np.einsum("ij,ij->i", offset, surface.normals)
    return replace(
        errors,
        ba_point=np.einsum("ij,ij->i", offset, offset),
        ba_plane=None if errors.ba_plane is None else along_normal**2,
    )
