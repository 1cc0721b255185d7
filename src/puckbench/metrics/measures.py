"""All distortions of a decoded cloud at once, as a result row has them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.mesh import Mesh


def measures(reference: PointCloud, decoded: Floats, peak: float | None = None) -> dict[str, float]:
    """All distortions in the reference's frame, as PSNRs and in metres.

    Parameters
    ----------
    reference
        The cloud that was coded; one without normals has no distances to planes.
    decoded : (m, 3)
        The decoded points, in the reference's frame.
    peak
        Peak of MPEG's PSNRs, in the reference's units; by default its own. Where it is not known
        they are left out, as is a PSNR without error.
    """
    from puckbench.metrics.geometry import distortion
    from puckbench.metrics.psnr import cd_psnr, mpeg_psnr
    from puckbench.metrics.units import in_metres

    found = distortion(reference, decoded)
    width = reference.about.get("diameter") or _diameter(reference)
    peak = peak or reference.peak
    psnrs = _finite({**(mpeg_psnr(found, peak) if peak else {}), **cd_psnr(found, width)})
    return {**found, **psnrs, **in_metres(found, reference.about.get("scale", 1.0))}


def picture_measures(
    reference: PointCloud, decoded: PointCloud, pixels: int, geometry: Mapping[str, float]
) -> dict[str, float]:
    """Measures of six pictures of that width, if any, and of colours where both clouds have them.

    Parameters
    ----------
    geometry
        What `measures` found, for the joint quality of geometry and colour.
    """
    found: dict[str, float] = {}
    if pixels:
        from puckbench.metrics.views import view_quality

        found |= view_quality(reference, decoded, pixels)
    if reference.colours is not None and decoded.colours is not None:
        from puckbench.metrics.colour import colour_distortion, joint_quality

        colour = colour_distortion(reference, decoded)
        found |= {**colour, "joint_quality": joint_quality(geometry, colour)}
    return _finite(found)


def truth_measures(
    reference: PointCloud,
    decoded: Floats,
    surface: Mesh | PointCloud | None,
    seen: PointCloud | None,
    clean: PointCloud | None,
) -> dict[str, float]:
    """Distortion against the true surface, in the reference's frame and in metres.

    Parameters
    ----------
    surface
        The true surface: a mesh in metres, or points in the reference's frame.
    seen
        Points of the true surface that the cloud's own stand for; drawn on the mesh if not given.
    clean
        The clean scan of the same rays, in place of `seen`.
    """
    from puckbench.geometry.closest import mesh_in_frame
    from puckbench.metrics.truth import scan_distortion, truth_distortion
    from puckbench.metrics.units import in_metres

    scale = reference.about.get("scale", 1.0)
    visible = clean or seen
    mesh = None
    if isinstance(surface, PointCloud):
        visible = visible or surface
    elif surface is not None:
        mesh = mesh_in_frame(surface, scale, reference.about.get("offset", (0.0, 0.0, 0.0)))
    if visible is None:
        visible = _sampled(mesh, len(reference))
    measure = truth_distortion if clean is None else scan_distortion
    found = measure(visible, mesh, decoded)
    return {**found, **in_metres(found, scale)}


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if math.isfinite(value)}


def _diameter(reference: PointCloud) -> float:
    from puckbench.metrics.diameter import diameter

    return float(diameter(reference.xyz))


def _sampled(mesh: Mesh | None, points: int) -> PointCloud:
    from puckbench.core.seeding import generator
    from puckbench.geometry.sampling import sample_surface

    assert mesh is not None  # noqa: S101 (there is a surface, and it is no cloud)
    return sample_surface(mesh, points, generator(0, "evaluate", "truth"))
