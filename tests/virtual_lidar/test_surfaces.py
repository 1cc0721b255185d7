"""Solids against closed-form volumes, and their labels against the primitives' equations."""

import numpy as np
import pytest

from pointkit.geometry.mesh import Mesh
from tests.support.scenes_residuals import plane_alignment, volume, worst_residual
from virtual_lidar.scenes import outlines, solids
from virtual_lidar.scenes.bodies import Body, build_mesh
from virtual_lidar.scenes.surfaces import Surface, pose

TURN = pose(0.3, -2.0, 1.1, turn=30, tilt=50, roll=-20, scale=1.7)
CORNER = outlines.polygon((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))
TRIANGLE = outlines.polygon((0, 0), (0.5, 0), (0, 0.5))
FLAT_GRID = np.stack(np.meshgrid([0, 1.0, 2], [0, 1.0], [0.0], indexing="ij"), axis=-1)[:, :, 0]
SOLIDS: dict[str, tuple[Surface, float]] = {
    "box": (solids.box(1, 2, 3), 6.0),
    "cylinder": (solids.cylinder(1, 2, 400), 2 * np.pi),
    "frustum": (solids.cone(2, 1, 3, 400), 7 * np.pi),
    "cone": (solids.cone(1, 0, 3, 400), np.pi),
    "sphere": (solids.sphere(1, 400), 4 / 3 * np.pi),
    "torus": (solids.torus(2, 0.5, 400, 200), np.pi**2),
    "ellipsoid": (solids.superquadric((1, 2, 0.5), (1, 1), 400), 4 / 3 * np.pi),
    "rounded box": (solids.superquadric((1, 2, 0.5), (0.3, 0.4), 100), 0.0),
    "prism": (solids.extrude(CORNER, 2), 6.0),
    "plate with hole": (
        solids.extrude(outlines.rectangle(2, 2), 0.5, [TRIANGLE]),
        0.5 * (4 - 0.125),
    ),
    "slab": (
        solids.extrude(outlines.rounded_rectangle(2, 1, 0.25, 100), 1),
        2 - (4 - np.pi) * 0.25**2,
    ),
    "straight pipe": (solids.pipe([(0, 0, 0), (0, 3, 0)], 0.5, 1, 400), 0.75 * np.pi),
    "bent pipe": (
        solids.pipe([(0, 0, 0), (2, 0, 0), (2, 2, 0)], 0.2, 0.5, 200),
        np.pi * 0.04 * (3 + np.pi / 4),
    ),
    "straight tube": (
        solids.tube(np.array([[0, 0, 0], [0, 0, 1.0], [0, 0, 3]]), 0.5, 400),
        0.75 * np.pi,
    ),
    "sheet": (
        solids.sheet(FLAT_GRID, 0.1),
        0.2,
    ),
}


def mesh_of(surface: Surface) -> Mesh:
    return build_mesh([Body("thing", "clutter", surface)])


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("moved", [np.eye(4), TURN], ids=["as made", "moved"])
def test_labels_fit_the_triangles(name: str, moved: np.ndarray) -> None:
    mesh = mesh_of(SOLIDS[name][0].transformed(moved))
    assert worst_residual(mesh) < 1e-9
    assert (plane_alignment(mesh) > 0.999).all()


@pytest.mark.parametrize("name", [name for name, (_, expected) in SOLIDS.items() if expected])
def test_volume_is_the_closed_form(name: str) -> None:
    surface, expected = SOLIDS[name]
    assert volume(mesh_of(surface)) == pytest.approx(expected, rel=2e-3)


def test_a_mirror_image_keeps_outward_normals_and_labels() -> None:
    surface = solids.cone(2, 1, 3, 64).at(1.0, 2.0, 3.0, tilt=40).mirrored()
    assert volume(mesh_of(surface)) > 0
    assert worst_residual(mesh_of(surface)) < 1e-9


def test_scaling_scales_lengths_and_keeps_angles() -> None:
    mesh = mesh_of(
        solids.cone(2, 1, 3, 16).at(scale=2.0) + solids.torus(2, 0.5, 8, 8).at(scale=2.0)
    )
    assert mesh.labels is not None
    by_kind = {item.kind: item.parameters for item in mesh.labels.primitives}
    assert by_kind["cone"]["half_angle"] == pytest.approx(np.arctan(1 / 3))
    assert by_kind["torus"]["major_radius"] == pytest.approx(4.0)
    assert by_kind["torus"]["minor_radius"] == pytest.approx(1.0)


def test_coplanar_faces_of_one_object_share_a_primitive_and_other_objects_do_not() -> None:
    two = solids.box(1, 1, 1) + solids.box(1, 1, 1).at(x=3.0)
    mesh = build_mesh([Body("a", "wall", two), Body("b", "wall", solids.box(1, 1, 1))])
    assert mesh.labels is not None
    assert len(mesh.labels.primitives) == 8 + 6
    assert [item.name for item in mesh.labels.objects] == ["a_1", "b_1"]
    assert len(np.intersect1d(mesh.labels.primitive_id[:24], mesh.labels.primitive_id[24:])) == 0


@pytest.mark.parametrize(
    ("outer", "holes", "area"),
    [
        (outlines.rectangle(4, 3), [], 12.0),
        (outlines.polygon((0, 0), (4, 0), (4, 4), (2, 1), (0, 4)), [], 10.0),
        (
            outlines.rectangle(4, 4),
            [((0.5, 0.5), 0.3), ((-1.0, 0.2), 0.4), ((0.2, -1.2), 0.5)],
            16.0,
        ),
    ],
)
def test_triangles_cover_the_polygon_once(
    outer: outlines.Outline, holes: list[tuple[outlines.Point, float]], area: float
) -> None:
    rings = [outlines.loop(outlines.circle(radius, 40, centre)) for centre, radius in holes]
    vertices, triangles = outlines.fill(outlines.loop(outer), rings)
    a, b, c = vertices[triangles].swapaxes(0, 1)
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    cut = sum(20 * radius**2 * np.sin(2 * np.pi / 40) for _, radius in holes)
    assert (doubled > 0).all()
    assert doubled.sum() / 2 == pytest.approx(area - cut)
