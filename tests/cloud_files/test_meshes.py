"""Mesh files: round trip, polygons, orientation, damage."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from cloud_files.meshes import read_mesh, read_mesh_report, write_mesh
from cloud_files.meshes.polygons import Polygons, triangulate
from pointkit.errors import InputError
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject

TETRAHEDRON = Mesh(
    np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]]) + 1 / 3,
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)


def labelled() -> Mesh:
    """A tetrahedron whose faces belong to two objects and two primitives."""
    labels = Labels(
        np.array([0, 1, 1, 0], dtype=np.int32),
        np.array([1, 0, 0, 1], dtype=np.int32),
        (SceneObject("floor_1", "floor"), SceneObject("chair_3", "chair")),
        (
            Primitive("plane", {"normal": np.array([0.0, 0.0, 1.0]), "offset": np.float64(1 / 3)}),
            Primitive("freeform", {}),
        ),
    )
    return Mesh(TETRAHEDRON.vertices, TETRAHEDRON.triangles, labels)


def test_own_format_keeps_every_bit_and_label(tmp_path: Path) -> None:
    mesh = labelled()
    write_mesh(tmp_path / "room.ply", mesh, {"seed": 3})
    again = read_mesh(tmp_path / "room.ply")
    assert np.array_equal(again.vertices, mesh.vertices)
    assert np.array_equal(again.triangles, mesh.triangles)
    assert again.labels is not None
    assert mesh.labels is not None
    assert np.array_equal(again.labels.object_id, mesh.labels.object_id)
    assert np.array_equal(again.labels.primitive_id, mesh.labels.primitive_id)
    assert again.labels.objects == mesh.labels.objects
    assert again.labels.primitives[0].parameters == {"normal": [0, 0, 1], "offset": 1 / 3}


def test_the_same_mesh_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_mesh(tmp_path / f"{name}.ply", labelled(), {"seed": 3})
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_a_reader_of_others_reads_our_format(tmp_path: Path) -> None:
    import trimesh

    write_mesh(tmp_path / "room.ply", labelled())
    theirs = trimesh.load(tmp_path / "room.ply", process=False)
    assert np.array_equal(theirs.faces, TETRAHEDRON.triangles)
    np.testing.assert_allclose(theirs.vertices, TETRAHEDRON.vertices, rtol=1e-7)


def test_ids_that_the_json_does_not_list_are_an_error(tmp_path: Path) -> None:
    write_mesh(tmp_path / "room.ply", labelled())
    (tmp_path / "room.json").write_text('{"puckbench": "mesh", "objects": [], "primitives": []}')
    with pytest.raises(InputError, match=r"room\.ply: a face has a label"):
        read_mesh(tmp_path / "room.ply")


def test_fans_cover_the_area_of_a_polygon(tmp_path: Path) -> None:
    turns = np.linspace(0, 2 * np.pi, 256, endpoint=False)
    ring = np.stack([np.cos(turns), np.sin(turns), np.zeros(256)], axis=1)
    mesh, face = triangulate(Polygons(ring, np.arange(256), np.array([256])), "disc")
    assert len(mesh.triangles) == 254
    assert (face == 0).all()
    assert mesh.areas().sum() == pytest.approx(128 * np.sin(2 * np.pi / 256), rel=1e-12)


def test_triangles_remember_their_faces() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    corners, sizes = np.array([0, 1, 0, 1, 2, 0, 1, 2, 3]), np.array([2, 3, 4])
    mesh, face = triangulate(Polygons(square, corners, sizes), "square")
    assert face.tolist() == [1, 2, 2]
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]


PLY_HEAD = "ply\nformat ascii 1.0\nelement vertex {v}\nproperty float x\nproperty float y\n"
PLY_TAIL = "property float z\nelement face {f}\nproperty list uchar int {name}\nend_header\n"


@pytest.mark.parametrize("name", ["vertex_indices", "vertex_index"])
def test_ascii_ply_with_a_quad_and_a_triangle(tmp_path: Path, name: str) -> None:
    head = PLY_HEAD.format(v=4) + PLY_TAIL.format(f=2, name=name)
    path = tmp_path / "mixed.ply"
    path.write_text(head + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 1 3\n")
    mesh, report = read_mesh_report(path)
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 3]]
    assert (report["faces"], report["polygons"]) == (2, 1)


def write_stl(path: Path, mesh: Mesh) -> None:
    """Write a binary STL as its specification says."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(mesh.triangles), dtype=record)
    rows["corners"] = mesh.corners()
    header = b"solid, but binary".ljust(80) + len(rows).to_bytes(4, "little")
    path.write_bytes(header + rows.tobytes())


def test_binary_stl_that_begins_with_solid(tmp_path: Path) -> None:
    write_stl(tmp_path / "part.stl", TETRAHEDRON)
    mesh = read_mesh(tmp_path / "part.stl")
    assert np.array_equal(mesh.corners(), TETRAHEDRON.corners().astype(np.float32))


def test_ascii_stl(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 0\n"
    path.write_text(f"solid part\n{facet}endloop\nendfacet\nendsolid part\n")
    assert read_mesh(path).corners().tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]


def test_glb_scene_is_placed_by_its_nodes_and_turned_to_z_up(tmp_path: Path) -> None:
    import trimesh

    part = trimesh.Trimesh(TETRAHEDRON.vertices, TETRAHEDRON.triangles, process=False)
    scene = trimesh.Scene()
    for height in (0.0, 10.0):
        shift = trimesh.transformations.translation_matrix([0, height, 0])
        scene.add_geometry(part, geom_name="part", node_name=f"n{height}", transform=shift)
    path = tmp_path / "scene.glb"
    path.write_bytes(scene.export(file_type="glb"))
    low, high = read_mesh(path).bounds()
    np.testing.assert_allclose(low, [1 / 3, -3 - 1 / 3, 1 / 3], rtol=1e-6)
    np.testing.assert_allclose(high, [1 + 1 / 3, -1 / 3, 12 + 1 / 3], rtol=1e-6)


def test_y_up_files_are_turned_without_mirroring(tmp_path: Path) -> None:
    path = tmp_path / "mast.obj"
    path.write_text("v 0 0 0\nv 0 5 0\nv 0 0 1\nf 1 2 3\n")
    turned = read_mesh(path, up="y")
    assert turned.vertices.tolist() == [[0, 0, 0], [0, 0, 5], [0, -1, 0]]
    assert turned.normals()[0] @ [1, 0, 0] == pytest.approx(read_mesh(path).normals()[0, 0])


def test_triangles_without_area_are_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "thin.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.3 0 0\nf 1 2 3\nf 1 2 4\nf 1 1 2\nf 1 1 1\n")
    mesh, report = read_mesh_report(path)
    assert mesh.triangles.tolist() == [[0, 1, 2]]
    assert (report["triangles"], report["zero_area"]) == (1, 3)


OBJ_FACES = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
PLY_TRIANGLE = PLY_HEAD.format(v=3) + PLY_TAIL.format(f=1, name="vertex_indices")
DAMAGED = {
    "missing.obj": None,
    "empty.obj": "",
    "nan.obj": "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n",
    "text.obj": "v 0 0 zero\nf 1 2 3\n",
    "short.obj": "v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "beyond.obj": OBJ_FACES + "f 1 2 4\n",
    "zeroth.obj": OBJ_FACES + "f 0 1 2\n",
    "fraction.obj": OBJ_FACES + "f 1 2 3.5\n",
    "huge.obj": OBJ_FACES + f"f 1 2 {10**30}\n",
    "flat.obj": OBJ_FACES + "f 1 2 2\n",
    "points.obj": OBJ_FACES,
    "empty.off": "",
    "cut.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n",
    "few.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n",
    "word.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 two\n",
    "flat.off": "OFF\n3 1 0\n0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "binary.off": "OFF BINARY\n\x00\x00",
    "negative.off": "OFF\n-3 1 0\n",
    "empty.ply": "",
    "cut.ply": PLY_TRIANGLE + "0 0 0\n1 0 0\n",
    "cloud.ply": PLY_HEAD.format(v=1) + "property float z\nend_header\n0 0 0\n",
    "stripes.ply": PLY_HEAD.format(v=1) + PLY_TAIL.format(f=0, name="stripes") + "0 0 0\n",
    "plane.ply": PLY_HEAD.format(v=1) + "element face 0\nproperty list uchar int vertex_indices\n"
    "end_header\n0 0\n",
    "cut.stl": "solid part\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n",
    "word.stl": "solid part\nvertex 0 0 zero\nendsolid\n",
    "short.stl": "STL",
    "long.stl": "x" * 200,
    "empty.glb": "",
    "foreign.glb": "not a GLB file at all",
    "cut.glb": "glTF\x02\x00\x00\x00\xff\x00\x00\x00",
    "junk.glb": "glTF\x02\x00\x00\x00\x20\x00\x00\x00\x0c\x00\x00\x00JSON{broken json}xx",
    "mesh.fbx": "Kaydara",
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damage_is_told_in_one_line_that_names_the_file(tmp_path: Path, name: str) -> None:
    content = DAMAGED[name]
    if content is not None:
        (tmp_path / name).write_bytes(content.encode("latin-1"))
    with pytest.raises(InputError) as caught:
        read_mesh(tmp_path / name)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / name}: ")
    assert "\n" not in message


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".glb"])
def test_every_truncation_of_a_binary_file_is_an_error(tmp_path: Path, suffix: str) -> None:
    import trimesh

    path = tmp_path / f"part{suffix}"
    part = trimesh.Trimesh(TETRAHEDRON.vertices, TETRAHEDRON.triangles, process=False)
    part.export(path)
    whole = path.read_bytes()
    assert len(read_mesh(path).triangles) == 4
    for kept in range(0, len(whole) - 1, max(1, len(whole) // 37)):
        path.write_bytes(whole[:kept])
        with pytest.raises(InputError):
            read_mesh(path)


def test_up_must_be_y_or_z(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="up: 'x'"):
        read_mesh(tmp_path / "any.obj", up="x")


def test_a_mesh_that_cannot_be_used_is_not_written(tmp_path: Path) -> None:
    empty = Mesh(TETRAHEDRON.vertices, np.empty((0, 3), dtype=np.int64))
    with pytest.raises(InputError, match="no faces"):
        write_mesh(tmp_path / "empty.ply", empty)
    assert list(tmp_path.iterdir()) == []


def test_compressed_meshes_are_read_like_others(tmp_path: Path) -> None:
    import trimesh

    for name in ("a.ply", "a.obj", "a.stl", "a.off"):
        trimesh.Trimesh(TETRAHEDRON.vertices, TETRAHEDRON.triangles).export(tmp_path / name)
        packed = tmp_path / f"{name}.gz"
        packed.write_bytes(gzip.compress((tmp_path / name).read_bytes()))
        mesh, report = read_mesh_report(packed)
        assert np.array_equal(mesh.corners(), read_mesh(tmp_path / name).corners())
        assert report["format"] == name[2:]
    packed.write_bytes(b"none")
    with pytest.raises(InputError, match=r"a\.off\.gz: damaged compressed file"):
        read_mesh(packed)


def test_a_mesh_without_labels_is_written_and_read(tmp_path: Path) -> None:
    write_mesh(tmp_path / "part.ply", TETRAHEDRON)
    again = read_mesh(tmp_path / "part.ply")
    assert again.labels is None
    assert np.array_equal(again.triangles, TETRAHEDRON.triangles)


def test_labelled_meshes_keep_triangles_without_area(tmp_path: Path) -> None:
    mesh = labelled()
    triangles = np.concatenate([mesh.triangles[:3], [[1, 1, 2]]])
    write_mesh(tmp_path / "room.ply", Mesh(mesh.vertices, triangles, mesh.labels))
    again, report = read_mesh_report(tmp_path / "room.ply")
    assert np.array_equal(again.triangles, triangles)
    assert (report["triangles"], report["zero_area"]) == (4, 1)


@pytest.mark.parametrize("label", [-1, 2])
def test_labels_begin_at_0_and_end_with_the_list(tmp_path: Path, label: int) -> None:
    mesh = labelled()
    write_mesh(tmp_path / "room.ply", mesh)
    data = bytearray((tmp_path / "room.ply").read_bytes())
    data[-8:-4] = label.to_bytes(4, "little", signed=True)
    (tmp_path / "room.ply").write_bytes(data)
    with pytest.raises(InputError, match=r"a face has a label that room\.json does not list"):
        read_mesh(tmp_path / "room.ply")


@pytest.mark.parametrize(("height", "kept"), [(1e-6, 2), (2.2e-9, 2), (1.8e-9, 1)])
def test_a_sliver_is_measured_by_its_longest_edge(tmp_path: Path, height: float, kept: int) -> None:
    path = tmp_path / "slivers.obj"
    sliver = f"v 0 0 0\nv 1000 0 0\nv 500 {height} 0\n"
    path.write_text(f"{sliver}v 1e6 1e6 0\nv 1000001 1e6 0\nv 1e6 1000001 0\nf 1 2 3\nf 4 5 6\n")
    assert len(read_mesh(path).triangles) == kept


@pytest.mark.parametrize("index", [-1, 4])
def test_a_face_refers_to_existing_vertices(index: int) -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    with pytest.raises(InputError, match="square: a face refers to a vertex that does not exist"):
        triangulate(Polygons(square, np.array([0, 1, 2, index]), np.array([4])), "square")
