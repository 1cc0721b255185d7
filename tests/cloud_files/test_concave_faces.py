"""Triangulation of concave faces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Outline

from cloud_files.meshes import read_mesh
from cloud_files.meshes.polygons import MAX_CORNERS, Polygons, triangulate
from pointkit.errors import InputError
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject

# The floor begins at a corner from which the far arm cannot be seen.
FLOOR = np.array([[4, 0], [4, 1], [1, 1], [1, 4], [0, 4], [0, 0.0]])
COMB = np.array(
    [[0, 0], [7, 0], [7, 3], [6, 3], [6, 1], [4, 1], [4, 3], [3, 3], [3, 1], [1, 1], [1, 3], [0, 3]]
)
ARROW = np.array([[0, 1], [-2, -1], [0, 0], [2, -1.0]])
# A square of 4 with a square hole of 2; the edge from (0, 0) to (1, 1) is passed twice.
FRAME = np.array([[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]])
AREAS = [(FLOOR, 7.0), (COMB, 13.0), (ARROW, 2.0), (FRAME, 12.0)]
OUTLINES = [outline for outline, _ in AREAS]


def cut(outline: np.ndarray) -> Mesh:
    """The triangles of one face, of corners (n, 2) on the floor or (n, 3)."""
    points = np.zeros((len(outline), 3))
    points[:, : outline.shape[1]] = outline
    return triangulate(Polygons(points, np.arange(len(points)), np.array([len(points)])), "face")[0]


def shoelace(outline: np.ndarray) -> float:
    """Signed area of a polygon (n, 2)."""
    x, y = outline.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@pytest.mark.parametrize("turn", range(12))
@pytest.mark.parametrize(("outline", "area"), AREAS)
def test_area_equals_that_of_the_polygon_from_any_first_corner(
    outline: np.ndarray, area: float, turn: int
) -> None:
    mesh = cut(np.roll(outline, turn, axis=0))
    assert mesh.areas().sum() == pytest.approx(area, rel=1e-12)
    assert (mesh.normals()[mesh.areas() > 0, 2] == np.sign(shoelace(outline))).all()


@pytest.mark.parametrize("outline", OUTLINES)
def test_winding_is_kept(outline: np.ndarray) -> None:
    mesh = cut(outline[::-1])
    assert (mesh.normals()[mesh.areas() > 0, 2] == -np.sign(shoelace(outline))).all()


@pytest.mark.parametrize("outline", OUTLINES)
def test_samples_lie_within_the_polygon(outline: np.ndarray) -> None:
    corners = cut(outline).corners()
    weights = np.random.default_rng(3).dirichlet([1.0, 1.0, 1.0], (len(corners), 200))
    points = (weights @ corners).reshape(-1, 3)
    assert (
        Outline(outline).contains_points(points[:, :2], radius=1e-9).all()
        or Outline(outline).contains_points(points[:, :2], radius=-1e-9).all()
    )


@pytest.mark.parametrize("outline", OUTLINES)
def test_a_polygon_may_lie_on_any_plane(outline: np.ndarray) -> None:
    from scipy.spatial.transform import Rotation

    flat = np.column_stack([outline, np.zeros(len(outline))])
    for rotation in Rotation.random(20, rng=np.random.default_rng(1)):
        placed = rotation.apply(flat) * 1e-3 + [4e5, 5e6, 100]  # millimetres, at UTM coordinates
        mesh = cut(placed)
        assert mesh.areas().sum() == pytest.approx(abs(shoelace(outline)) * 1e-6, rel=1e-5)
        up = rotation.apply([0, 0, np.sign(shoelace(outline))])
        assert (mesh.normals()[mesh.areas() > 1e-9] @ up > 0.99).all()


def test_a_face_that_is_not_plane_is_cut_on_its_best_plane() -> None:
    heights = np.random.default_rng(0).normal(scale=0.05, size=len(COMB))
    mesh = cut(np.column_stack([COMB, heights]))
    flat = Mesh(mesh.vertices * [1, 1, 0], mesh.triangles)
    assert flat.areas().sum() == pytest.approx(13)
    assert (flat.normals()[:, 2] >= 0).all()


@settings(max_examples=100, deadline=None)
@given(st.integers(4, 40), st.integers(0, 2**32 - 1))
def test_area_of_random_polygons(corners: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(corners) + rng.uniform(0, 0.9, corners)) / corners
    radii = rng.uniform(0.05, 1, corners)
    outline = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if shoelace(outline) < 0.01:
        return
    mesh = cut(outline)
    assert mesh.areas().sum() == pytest.approx(shoelace(outline), rel=1e-9)


def test_convex_faces_keep_their_fans_beside_concave_ones() -> None:
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    outlines = [square, FLOOR, square[:3], COMB, square]
    points = np.concatenate(outlines)
    sizes = np.array([len(outline) for outline in outlines])
    vertices = np.column_stack([points, np.zeros(len(points))])
    mesh, face = triangulate(Polygons(vertices, np.arange(len(points)), sizes), "rooms")
    assert (np.diff(face) >= 0).all()
    assert mesh.triangles[face == 0].tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.triangles[face == 2].tolist() == [[10, 11, 12]]
    assert (mesh.triangles[face == 4] - sizes[:4].sum()).tolist() == [[0, 1, 2], [0, 2, 3]]
    areas = np.bincount(face, mesh.areas())
    np.testing.assert_allclose(areas, [1, 7, 0.5, 13, 1])


def test_labels_go_with_the_triangles_of_their_face() -> None:
    points = np.column_stack([np.concatenate([FLOOR, FLOOR + 9]), np.zeros(12)])
    ids = np.array([1, 0], dtype=np.int32)
    labels = Labels(
        ids, ids, (SceneObject("a", "a"), SceneObject("b", "b")), (Primitive("plane", {}),) * 2
    )
    mesh, face = triangulate(Polygons(points, np.arange(12), np.array([6, 6]), labels=labels), "x")
    assert mesh.labels is not None
    assert np.array_equal(mesh.labels.object_id, ids[face])


def test_crossing_edges_leave_no_more_than_one_half() -> None:
    bow = np.array([[0, 0], [1, 1], [1, 0], [0, 1.0]])  # covers one half of the unit square
    assert 0.25 <= cut(bow).areas().sum() <= 0.5


def test_crossing_edges_on_any_plane() -> None:
    bow = np.array([[0, 0, 0], [0, 1, 1], [0, 1, 0], [0, 0, 1.0]])
    for points in (bow, bow[:, [1, 0, 2]], bow[:, [1, 2, 0]], bow[[1, 2, 3, 0]]):
        mesh = cut(points)
        assert 0.25 <= mesh.areas().sum() <= 0.5
        assert np.isfinite(mesh.vertices).all()


def test_a_face_without_area_gives_triangles_without_area() -> None:
    line = np.array([[0, 0], [1, 0], [3, 0], [2, 0.0]])
    assert cut(line).areas().sum() == 0
    assert cut(np.zeros((5, 3))).areas().sum() == 0


def test_a_concave_face_of_very_many_corners_is_refused() -> None:
    count = MAX_CORNERS // 2 + 1
    x, y = np.arange(count), np.arange(count) % 2 * 5.0
    zigzag = np.concatenate([np.stack([x, y], 1), np.stack([x, y + 1], 1)[::-1]])
    with pytest.raises(InputError, match=r"^face: face 1 is concave and has 5002 corners \(at"):
        cut(zigzag)
    assert len(cut(zigzag[1:-1]).triangles) == MAX_CORNERS - 2


def test_a_round_face_of_very_many_corners_is_a_fan() -> None:
    angles = np.linspace(0, 2 * np.pi, 2 * MAX_CORNERS, endpoint=False)
    mesh = cut(np.stack([np.cos(angles), np.sin(angles)], axis=1))
    assert mesh.triangles[:, 0].max() == 0
    assert mesh.areas().sum() == pytest.approx(np.pi, rel=1e-6)


@pytest.mark.parametrize("suffix", [".obj", ".off", ".ply"])
def test_every_format_of_polygons(tmp_path: Path, suffix: str) -> None:
    rows = [f"{x} {y} 0" for x, y in FLOOR.tolist()]
    texts = {
        ".obj": "\n".join([*(f"v {row}" for row in rows), "f 1 2 3 4 5 6"]),
        ".off": "\n".join(["OFF", "6 1 0", *rows, "6 0 1 2 3 4 5"]),
        ".ply": "\n".join(
            [
                *("ply", "format ascii 1.0", "element vertex 6"),
                *(f"property double {axis}" for axis in "xyz"),
                *("element face 1", "property list uchar int vertex_indices", "end_header"),
                *rows,
                "6 0 1 2 3 4 5\n",
            ]
        ),
    }
    path = tmp_path / f"floor{suffix}"
    path.write_text(texts[suffix])
    mesh = read_mesh(path)
    assert mesh.areas().sum() == pytest.approx(7)
    assert (mesh.normals()[:, 2] == 1).all()
