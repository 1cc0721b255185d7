"""GLB scenes compared with trimesh and the specification."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from cloud_files.meshes import read_mesh, read_mesh_report
from cloud_files.meshes.reading import y_up_to_z_up
from pointkit.errors import InputError
from tests.cloud_files.corpus.meshes import FAN, STRIP, UPRIGHT, glb, primitive, vec3, views


def test_a_scene_of_another_program_is_read_as_that_reads_it(tmp_path: Path) -> None:
    import trimesh

    rng = np.random.default_rng(4)
    scene = trimesh.Scene()
    parent = None
    for number in range(6):
        matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
        matrix[:3, :3] *= rng.uniform(0.5, 2)
        matrix[:3, 3] = rng.normal(size=3)
        part = trimesh.creation.box(rng.uniform(1, 2, 3))
        scene.add_geometry(part, f"node{number}", f"part{number}", parent, transform=matrix)
        parent = f"node{number}"
    path = tmp_path / "scene.glb"
    path.write_bytes(scene.export(file_type="glb"))
    theirs = trimesh.load_scene(path).to_geometry()
    mesh = read_mesh(path)
    expected = y_up_to_z_up(theirs.triangles_center)
    result = mesh.corners().mean(axis=1)
    order, other = np.lexsort(np.round(expected, 3).T), np.lexsort(np.round(result, 3).T)
    np.testing.assert_allclose(result[other], expected[order], atol=1e-5)
    normals = y_up_to_z_up(np.asarray(theirs.face_normals))
    np.testing.assert_allclose(mesh.normals()[other], normals[order], atol=1e-4)


def test_a_mirrored_node_keeps_its_front(tmp_path: Path) -> None:
    path = tmp_path / "mirrored.glb"
    glb(nodes=[{"mesh": 0, "scale": [1, 1, -1]}])(path)
    assert read_mesh(path).normals().tolist() == [[0, 1, 0]]
    glb()(path)
    assert read_mesh(path).normals().tolist() == [[0, -1, 0]]


@pytest.mark.parametrize(("binary", "mode"), [(STRIP, 5), (FAN, 6)])
def test_triangles_of_strips_and_fans_have_one_orientation(
    tmp_path: Path, binary: bytes, mode: int
) -> None:
    path = tmp_path / "part.glb"
    glb(binary, accessors=[vec3(0, 4)], meshes=primitive(mode=mode))(path)
    mesh = read_mesh(path)
    assert len(mesh.triangles) == 2
    assert (mesh.normals() == [0, -1, 0]).all()


def test_a_fan_begins_with_its_second_corner(tmp_path: Path) -> None:
    path = tmp_path / "fan.glb"
    glb(FAN, accessors=[vec3(0, 4)], meshes=primitive(mode=6))(path)
    assert read_mesh(path).triangles.tolist() == [[1, 2, 0], [2, 3, 0]]


def test_signed_bytes_are_numbers_from_minus_one_to_one(tmp_path: Path) -> None:
    path = tmp_path / "bytes.glb"
    rows = struct.pack("<9b", 127, 0, 0, -128, 0, 0, 64, 127, -127)
    glb(rows, accessors=[vec3(0, kind=5120, normalized=True)])(path)
    assert read_mesh(path).vertices.tolist() == [[1, 0, 0], [-1, 0, 0], [64 / 127, 1, 1]]
    glb(rows, accessors=[vec3(0, kind=5120)])(path)
    assert read_mesh(path).vertices.tolist() == [[127, 0, 0], [-128, 0, 0], [64, 127, 127]]


def test_offsets_of_view_and_accessor_add_up(tmp_path: Path) -> None:
    path = tmp_path / "offsets.glb"
    rows = np.array(UPRIGHT, dtype="<f4").tobytes()
    glb(
        b"\1" * 12 + rows,
        bufferViews=[{"buffer": 0, "byteOffset": 4, "byteLength": 44}],
        accessors=[vec3(0, byteOffset=8)],
    )(path)
    assert read_mesh(path).vertices.tolist() == y_up_to_z_up(np.array(UPRIGHT)).tolist()


def test_zeros_changed_in_places(tmp_path: Path) -> None:
    path = tmp_path / "sparse.glb"
    indices, values = struct.pack("<2B2x", 1, 2), struct.pack("<6f", 1, 0, 0, 0, 1, 0)
    sparse = {
        "count": 2,
        "indices": {"bufferView": 0, "componentType": 5121},
        "values": {"bufferView": 1},
    }
    glb(
        indices + values,
        bufferViews=views(indices, values),
        accessors=[vec3(None, 4, sparse=sparse)],
    )(path)
    assert read_mesh(path).vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 0]]


def test_only_the_scene_that_is_shown_is_read(tmp_path: Path) -> None:
    path = tmp_path / "two.glb"
    nodes = [{"mesh": 0}, {"mesh": 0, "translation": [7, 0, 0]}]
    scenes = [{"nodes": [0]}, {"nodes": [1]}]
    glb(nodes=nodes, scenes=scenes, scene=1)(path)
    assert read_mesh(path).vertices[0].tolist() == [7, 0, 0]
    glb(nodes=nodes, scenes=scenes)(path)
    assert read_mesh(path).vertices[0].tolist() == [0, 0, 0]


def test_unknown_chunks_and_bytes_after_the_file_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "chunks.glb"
    glb()(path)
    data = path.read_bytes()
    extra = struct.pack("<I4s", 4, b"WHAT") + b"1234"
    length = struct.pack("<I", len(data) + len(extra))
    path.write_bytes(data[:8] + length + data[12:] + extra + b"beyond")
    assert len(read_mesh(path).triangles) == 1


def test_a_chunk_that_reaches_beyond_the_file_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "cut.glb"
    glb()(path)
    data = bytearray(path.read_bytes())
    data[12:16] = struct.pack("<I", len(data))
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"cut\.glb: a chunk of the GLB file is truncated"):
        read_mesh(path)


@pytest.mark.parametrize("shown", ["instances", "primitives"])
def test_a_small_file_that_shows_its_mesh_very_often_is_refused(tmp_path: Path, shown: str) -> None:
    path = tmp_path / "many.glb"
    binary = bytes(300_000)
    many: dict[str, list[dict[str, object]]] = {
        "instances": {"nodes": [{"mesh": 0}] * 3000, "scenes": [{"nodes": list(range(3000))}]},
        "primitives": {"meshes": [{"primitives": primitive()[0]["primitives"] * 3000}]},
    }[shown]
    glb(binary, accessors=[vec3(0, 25_000)], **many)(path)
    with pytest.raises(InputError, match=r"many\.glb: its scene is too large for a file"):
        read_mesh(path)


def test_primitives_without_faces_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "mixed.glb"
    parts = [primitive(mode=mode)[0]["primitives"][0] for mode in (0, 1, 2, 3, 4)]
    glb(meshes=[{"primitives": parts}])(path)
    assert read_mesh_report(path)[1]["skipped"] == {"primitives_without_faces": 4}
