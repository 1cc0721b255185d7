"""OBJ and OFF files as programs write them."""

from pathlib import Path

import numpy as np
import pytest

from cloud_files.meshes import read_mesh, read_mesh_report
from cloud_files.meshes.obj import parse_obj
from pointkit.errors import InputError

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def corners(text: str) -> list[list[int]]:
    """The faces of an OBJ text, as indices from 0."""
    polygons = parse_obj(text.encode(), "test")
    return [part.tolist() for part in np.split(polygons.corners, np.cumsum(polygons.sizes)[:-1])]


@pytest.mark.parametrize(
    "face", ["1 2 3 4", "1/1 2/2 3/3 4/4", "1//1 2//1 3//1 4//1", "1/1/1 2/2/1 3/3/1 4/4/1"]
)
def test_every_form_of_a_face(face: str) -> None:
    assert corners(f"{SQUARE}vt 0 0\nvn 0 0 1\nf {face}\n") == [[0, 1, 2, 3]]


def test_negative_indices_count_back_from_the_last_vertex_before_their_face() -> None:
    early = "f -4 -3 -2\n"
    late = "v 2 2 0\nf -1//-1 -5//-1 1//-1\n"
    assert corners(SQUARE + early + late) == [[0, 1, 2], [4, 0, 0]]


@pytest.mark.parametrize("face", ["-1 -2 -1", "-1 -7 -1", "1 0 1"])
def test_an_index_before_the_first_vertex_is_an_error(tmp_path: Path, face: str) -> None:
    path = tmp_path / "early.obj"
    path.write_text(f"v 0 0 0\nf {face}\n")
    with pytest.raises(InputError, match="vertex that does not exist"):
        read_mesh(path)


def test_faces_may_come_before_their_vertices() -> None:
    assert corners(f"f 1 2 3\n{SQUARE}") == [[0, 1, 2]]


def test_blanks_tabs_carriage_returns_and_continued_lines() -> None:
    text = "\tv 0 0 0\r\nv\t1  0 0 \r\nv 1 1 0\r\n\r\n# v 9 9 9\r\n  f 1 \\\r\n 2 3\r\n"
    assert corners(text) == [[0, 1, 2]]


def test_colours_and_weights_after_the_coordinates_are_ignored() -> None:
    polygons = parse_obj(b"v 0 0 0 1\nv 1 0 0 0.5 0.5 0.5\nv 0 1 0\nf 1 2 3\n", "test")
    assert polygons.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_every_face_has_the_material_in_use_before_it() -> None:
    text = f"{SQUARE}f 1 2 3\nusemtl red\nusemtl  blue sky\nf 1 2 3\ns off\nf 1 3 4\n"
    text += "usemtl red\nl 1 2\nf 1 2 4\nusemtl green\n"
    polygons = parse_obj(text.encode(), "test")
    assert polygons.materials == ("red", "blue sky", "green")
    assert polygons.material_id is not None
    assert polygons.material_id.tolist() == [-1, 1, 1, 0]
    assert parse_obj(f"{SQUARE}f 1 2 3\n".encode(), "test").material_id is None


def test_what_has_no_surface_is_counted_as_skipped(tmp_path: Path) -> None:
    path = tmp_path / "mixed.obj"
    path.write_text(
        f"mtllib a.mtl\no thing\ng part\ns 1\nusemtl red\n{SQUARE}f 1 2 3 4\nl 1 2 3\nl 1 2\n"
        "p 1\nf 1 2\ncurv 0 1 1 2\n"
    )
    mesh, report = read_mesh_report(path)
    assert len(mesh.triangles) == 2
    assert report["skipped"] == {
        "polylines": 2,
        "point_elements": 1,
        "curves": 1,
        "faces_of_one_or_two_corners": 1,
    }


def test_a_thousand_faces_keep_their_order_and_values(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    vertices, faces = (
        rng.normal(size=(500, 3)),
        rng.permuted(np.tile(np.arange(500), (1000, 1)), axis=1)[:, :3],
    )
    path = tmp_path / "big.obj"
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {a}/{b}/{c} {b}/{a}/{c} {c}/{c}/{a}" for a, b, c in (faces + 1).tolist()]
    path.write_text("\n".join(lines))
    mesh = read_mesh(path)
    assert np.array_equal(mesh.vertices, vertices)
    assert np.array_equal(mesh.triangles, faces)


@pytest.mark.parametrize(
    "head",
    [
        "OFF\n4 1 0\n",
        "OFF4 1 0\n",
        "OFF 4 1 4\n",
        "off\n4 1 0\n",
        "4 1 0\n",
        "# made by hand\nOFF # header\n\n4 1 0 # counts\n",
        "COFF\n4 1 0\n",
        "OFF\r\n4 1 0\r\n",
    ],
)
@pytest.mark.parametrize("face", ["4 0 1 2 3", "4 0 1 2 3 255 0 0", "4 0 1 2 3 0.5 0.5 0.5 # red"])
def test_off_headers_colours_and_comments(tmp_path: Path, head: str, face: str) -> None:
    path = tmp_path / "square.off"
    extra = " 255 0 0 255" if head.startswith("COFF") else ""
    rows = [f"{x} {y} 0{extra}" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    path.write_text(head + "\n".join(rows) + f"\n\n{face}\n")
    mesh, report = read_mesh_report(path)
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert report["polygons"] == 1
    assert mesh.areas().sum() == pytest.approx(1)


LONG = "9" * 60


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("v 0 0 0 1 1 1\nv 0 0\nv 0 zero 0\n", "not a vertex: '0 0'"),
        ("v 0 0 0 1 1 1\nv 0 zero 0\n", "not a vertex: '0 zero 0'"),
        (f"{SQUARE}f 1/2/3 -2//1 3\nf 1 2 x\n", "not a face: '1 2 x'"),
        (f"{SQUARE}f 1 2 {10**17}\nf 1 2 {10**18}0\n", "not a face: '1 2 10000000000000000000'"),
        (f"{SQUARE}f 1 2 {LONG}\n", f"not a face: '1 2 {LONG[:56]}'"),
        (f"{SQUARE}f 1 2 --3\n", "not a face: '1 2 --3'"),
    ],
)
def test_the_line_at_fault_is_shown(text: str, fault: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_obj(text.encode(), "test")
    assert str(caught.value) == f"test: {fault}"


@pytest.mark.parametrize(
    ("counts", "fault"),
    [
        ("0 0 0", "the mesh has no faces"),
        ("1 0 0\n0 0 0", "the mesh has no faces"),
        ("-1 0 0", "the counts of the OFF file are negative"),
        ("0 -1 0", "the counts of the OFF file are negative"),
        ("4", "not a readable OFF file (no counts at its start)"),
    ],
)
def test_counts_of_off_files(tmp_path: Path, counts: str, fault: str) -> None:
    path = tmp_path / "counts.off"
    path.write_text(f"OFF\n{counts}\n")
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert str(caught.value) == f"{path}: {fault}"
