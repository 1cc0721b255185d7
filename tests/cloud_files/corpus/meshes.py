"""Meshes as programs write them: OBJ, OFF, PLY, STL and GLB."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.support.corpus_case import Case, content

FLOOR = [(4, 0, 0), (4, 1, 0), (1, 1, 0), (1, 4, 0), (0, 4, 0), (0, 0, 0)]
"""An L of area 7; a fan about its first corner has an area of 13."""
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
TRIANGLE = SQUARE[:3]


def rows(points: list[tuple[float, ...]], before: str = "") -> str:
    """Lines of points."""
    return "".join(f"{before}{' '.join(map(str, point))}\n" for point in points)


V_SQUARE = rows(SQUARE, "v ")


def obj(name: str, text: str | bytes, area: float | None = 1, **more: Any) -> Case:
    """An OBJ file of the square's vertices, unless another case says otherwise."""
    return Case(f"{name}.obj", content(text), "mesh", area=area, **{"points": SQUARE, **more})


def ply(
    vertices: str, faces: str, kinds: str = "uchar int", counts: tuple[int, int] = (3, 1)
) -> str:
    """An ASCII PLY."""
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat ascii 1.0\nelement vertex {counts[0]}\n{axes}element face {counts[1]}\n"
        f"property list {kinds} vertex_indices\nend_header\n{vertices}{faces}"
    )


def binary_ply(vertices: int, faces: int, body: bytes) -> bytes:
    """A binary PLY that announces so many rows."""
    head = ply("", "", counts=(vertices, faces))
    return head.replace("ascii", "binary_little_endian").encode() + body


def stl(header: bytes, count: int, body: bytes) -> bytes:
    """A binary STL."""
    return header.ljust(80) + struct.pack("<I", count) + body


FACET = struct.pack("<12fH", 0, 0, 1, *(x for point in TRIANGLE for x in point), 0)
LOOP = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
FLOATS = struct.pack("<9f", *(x for point in TRIANGLE for x in point))
"""In glTF's frame, y up: read, y becomes -z and z becomes y."""
UPRIGHT = [(0, 0, 0), (1, 0, 0), (1, 0, 1)]


def glb(binary: bytes = FLOATS, **changes: Any) -> Callable[[Path], None]:
    """A GLB file of one triangle, with some parts of its tree replaced."""
    accessor = {"bufferView": 0, "count": 3, "componentType": 5126, "type": "VEC3"}
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [accessor],
        "bufferViews": [{"buffer": 0, "byteLength": len(binary)}],
        "buffers": [{"byteLength": len(binary)}],
        **changes,
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return content(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def primitive(**more: Any) -> list[dict[str, Any]]:
    """Meshes of one primitive."""
    return [{"primitives": [{"attributes": {"POSITION": 0}, **more}]}]


def views(*parts: bytes) -> list[dict[str, int]]:
    """Buffer views of parts that follow each other."""
    starts = [sum(map(len, parts[:k])) for k in range(len(parts))]
    return [
        {"buffer": 0, "byteOffset": start, "byteLength": len(part)}
        for start, part in zip(starts, parts, strict=True)
    ]


def vec3(view: int | None, count: int = 3, kind: int = 5126, **more: Any) -> dict[str, Any]:
    """An accessor of positions."""
    place = {} if view is None else {"bufferView": view}
    return {**place, "count": count, "componentType": kind, "type": "VEC3", **more}


STRIP = struct.pack("<12f", 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0)
FAN = struct.pack("<12f", *(x for point in SQUARE for x in point))
INDICES = struct.pack("<3H2x", 0, 1, 2)
SHIFTED = [(2 * x + 10, y, 2 * z) for x, y, z in UPRIGHT]
MOVED_POINT = struct.pack("<H2x3f", 2, 0, 5, 0)
QUANTISED = struct.pack("<12h", 0, 0, 0, 0, 32767, 0, 0, 0, 32767, 32767, 0, 0)

CASES = [
    # ---- OBJ
    obj("weights_of_one", rows([(*p, 1) for p in SQUARE], "v ") + "f 1 2 3 4\n"),
    obj(
        "weights",
        rows([(*p, 2) for p in SQUARE], "v ") + "f 1 2 3 4\n",
        error="weights.obj: not a vertex in space, but with a weight: '0 0 0 2'",
    ),
    obj(
        "decimal_comma", "v 0,5 0 0\nf 1 1 1\n", error="decimal_comma.obj: not a vertex: '0,5 0 0'"
    ),
    obj("concave_face", rows(FLOOR, "v ") + "f 1 2 3 4 5 6", 7, points=FLOOR),
    obj("clockwise_face", V_SQUARE + "f 4 3 2 1\n"),
    obj("normals_without_texture", V_SQUARE + "vn 0 0 1\nf 1//1 2//1 3//1 4//1\n"),
    obj("indices_that_count_back", V_SQUARE + "f -4 -3 -2 -1\n"),
    obj("groups_and_objects", f"o a\ng b c\n{V_SQUARE}g d\ns off\nf 1 2 3\ng e\nf 1 3 4\n"),
    obj("continued_lines", V_SQUARE + "f 1 2 \\\n 3 \\\r\n 4\n"),
    obj("comment_after_face", V_SQUARE + "f 1 2 3 4 # floor\n"),
    obj("colours", rows(SQUARE, "v ").replace("\n", " 0.5 0.5 0.5\n") + "f 1 2 3 4\n"),
    obj("byte_order_mark", b"\xef\xbb\xbf" + f"{V_SQUARE}f 1 2 3 4\n".encode()),
    obj("repeated_index", V_SQUARE + "f 1 2 3 3 4\n"),
    obj(
        "no_such_vertex", V_SQUARE + "f 1 2 5\n", error=r"no_such_vertex.obj: a face refers to a v"
    ),
    obj("vertex_zero", V_SQUARE + "f 0 1 2\n", error=r"vertex_zero.obj: a face refers to a vertex"),
    obj("two_corners", V_SQUARE + "f 1 2\n", error=r"two_corners.obj: the mesh has no faces"),
    obj(
        "not_a_number", f"v 0 0 nan\n{V_SQUARE}f 1 2 3\n", error=r"a face has a vertex that is not"
    ),
    obj("unused_nan", f"{V_SQUARE}v nan nan nan\nf 1 2 3 4\n", points=SQUARE),
    obj(
        "lines_beside_faces",
        V_SQUARE + "f 1 2 3 4\nl 1 2\np 1\n",
        warning=r"lines_beside_faces.obj: left out: 1 polylines, 1 point elements",
    ),
    # ---- OFF
    *(
        Case(f"{name}.off", content(text), "mesh", points=SQUARE, area=1)
        for name, text in {
            "colours_of_vertices": "COFF\n4 1 4\n" + rows([(*p, 9, 9, 9, 255) for p in SQUARE]),
            "normals_of_vertices": "NOFF\n4 1 4\n" + rows([(*p, 0, 0, 1) for p in SQUARE]),
            "counts_beside_the_name": "OFF 4 1 0 # counts\n\n# four\n" + rows(SQUARE),
            "counts_glued_to_the_name": "OFF4 1 0\n" + rows(SQUARE),
        }.items()
        for text in [text + "4 0 1 2 3 0.2 0.2 0.2 # grey\n"]
    ),
    Case(
        "many.off",
        content("OFF\n3 1000000000 0\n"),
        "mesh",
        error=r"many.off: truncated: 0 lines for",
    ),
    Case(
        "more_faces.off",
        content("OFF\n3 1 0\n" + rows(TRIANGLE) + "3 0 1 2\n3 0 2 1\n"),
        "mesh",
        points=TRIANGLE,
        warning="left out 1 lines after its 1 faces",
    ),
    Case(
        "decimal_comma.off",
        content("OFF\n3 1 0\n0,5 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        "mesh",
        error="a vertex is not three numbers",
    ),
    Case(
        "huge_index.off",
        content("OFF\n3 1 0\n" + rows(TRIANGLE) + f"3 0 1 {10**25}\n"),
        "mesh",
        error=r"huge_index.off: a face refers to a vertex that does not exist",
    ),
    Case(
        "homogeneous.off",
        content("4OFF\n3 1 0\n0 0 0 1\n1 0 0 1\n0 1 0 1\n3 0 1 2\n"),
        "mesh",
        error=r"homogeneous.off: not a readable OFF file",
    ),
    # ---- PLY
    Case(
        "triangle_and_quad.ply",
        content(ply(rows(SQUARE), "3 0 1 2\n4 0 1 2 3\n", counts=(4, 2))),
        "mesh",
        points=SQUARE,
        area=1.5,
    ),
    Case(
        "quads.ply",
        content(binary_ply(4, 2, FAN + 2 * struct.pack("<B4i", 4, 0, 1, 2, 3))),
        "mesh",
        points=SQUARE,
        area=2,
    ),
    Case(
        "wide_lists.ply",
        content(ply(rows(TRIANGLE), "3 0 1 2\n", "uint uint")),
        "mesh",
        points=TRIANGLE,
        area=0.5,
    ),
    Case(
        "fractions.ply",
        content(ply(rows(TRIANGLE), "3 0 1.7 2\n", "uchar float")),
        "mesh",
        error=r"fractions.ply: vertex_indices of the faces are not integers",
    ),
    Case(
        "triangle_strips.ply",
        content(ply(rows(TRIANGLE), "3 0 1 2\n").replace("element face", "element tristrips")),
        "mesh",
        error=r"triangle_strips.ply: its faces are triangle strips",
    ),
    Case(
        "not_a_list.ply",
        content(ply(rows(TRIANGLE), "0\n").replace("list uchar int", "int")),
        "mesh",
        error=r"not_a_list.ply: vertex_indices of the faces is not a list",
    ),
    Case(
        "lists_of_places.ply",
        content(ply("1 0 0 0\n" * 3, "3 0 1 2\n").replace("float x", "list uchar float x")),
        "mesh",
        error=r"lists_of_places.ply: x, y, z of the vertices are not numbers",
    ),
    *(
        Case(f"many_{name}.ply", content(data), "mesh", error=r"truncated: its header says")
        for name, data in {
            "vertices": binary_ply(10**9, 1, FLOATS),
            "faces": binary_ply(3, 10**9, FLOATS + struct.pack("<B3i", 3, 0, 1, 2)),
            "lines": ply(rows(TRIANGLE), "3 0 1 2\n", counts=(3, 10**9)),
        }.items()
    ),
    Case(
        "long_list.ply",
        content(binary_ply(3, 1, FLOATS + b"\xff").replace(b"uchar int", b"int int")),
        "mesh",
        error=r"long_list.ply: not a readable PLY file",
    ),
    # ---- STL
    Case("named_solid.stl", content(stl(b"solid", 1, FACET)), "mesh", points=TRIANGLE, area=0.5),
    Case(
        "longer_than_it_says.stl",
        content(stl(b"solid", 1, FACET * 2 + b"end")),
        "mesh",
        points=TRIANGLE,
        warning=r"longer_than_it_says.stl: left out 53 bytes after its 1 triangles",
    ),
    Case(
        "many.stl", content(stl(b"", 10**9, FACET)), "mesh", error=r"many.stl: truncated or not S"
    ),
    Case(
        "loop_of_four.stl",
        content(f"solid a\n{LOOP.format(rows(SQUARE, 'vertex '))}endsolid a\n"),
        "mesh",
        points=SQUARE,
        area=1,
    ),
    Case(
        "two_solids.stl",
        content(2 * f"SOLID a\n{LOOP.format(rows(TRIANGLE, 'VERTEX '))}ENDSOLID a\n"),
        "mesh",
        points=TRIANGLE * 2,
        area=1,
    ),
    Case(
        "second_solid_cut.stl",
        content(f"solid a\n{LOOP.format(rows(TRIANGLE, 'vertex '))}endsolid a\nsolid b\n"),
        "mesh",
        error="second_solid_cut.stl: truncated: the solid has no end",
    ),
    Case(
        "open_loop.stl",
        content(f"solid a\nouter loop\n{rows(TRIANGLE, 'vertex ')}endsolid a\n"),
        "mesh",
        error=r"open_loop.stl: a vertex lies outside of the loops",
    ),
    # ---- GLB
    Case("triangle.glb", glb(), "mesh", points=UPRIGHT, area=0.5),
    Case(
        "nested_nodes.glb",
        glb(
            nodes=[
                {"children": [1], "translation": [10, 0, 0]},
                {"mesh": 0, "scale": [2, 2, 2]},
            ]
        ),
        "mesh",
        points=SHIFTED,
        area=2,
    ),
    Case(
        "quarter_turn.glb",  # of a quarter about y: x becomes -z, which is read as y
        glb(nodes=[{"mesh": 0, "rotation": [0, 0.5**0.5, 0, 0.5**0.5]}]),
        "mesh",
        points=[(0, 0, 0), (0, 1, 0), (0, 1, 1)],
        area=0.5,
    ),
    Case(
        "matrix.glb",
        glb(nodes=[{"mesh": 0, "matrix": [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 10, 0, 0, 1]}]),
        "mesh",
        points=SHIFTED,
        area=2,
    ),
    Case(
        "instances_and_a_camera.glb",
        glb(
            nodes=[{"mesh": 0}, {"mesh": 0, "camera": 0, "translation": [5, 0, 0]}, {"mesh": 0}],
            scenes=[{"nodes": [0, 1]}],
            cameras=[{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}],
        ),
        "mesh",
        points=[*UPRIGHT, *((x + 5, y, z) for x, y, z in UPRIGHT)],
        area=1,
    ),
    Case(
        "without_scenes.glb",
        glb(scenes=[], nodes=[{"mesh": 0}, {"children": [0], "translation": [10, 0, 0]}]),
        "mesh",
        points=[(x + 10, y, z) for x, y, z in UPRIGHT],
    ),
    Case(
        "strip.glb",
        glb(STRIP, accessors=[vec3(0, 4)], meshes=primitive(mode=5)),
        "mesh",
        points=[(0, 0, 0), (1, 0, 0), (0, 0, 1), (1, 0, 1)],
        area=1,
    ),
    Case(
        "fan.glb",
        glb(FAN, accessors=[vec3(0, 4)], meshes=primitive(mode=6)),
        "mesh",
        points=[(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
        area=1,
    ),
    Case(
        "lines_beside_triangles.glb",
        glb(
            meshes=[
                {"primitives": [*primitive(mode=1)[0]["primitives"], *primitive()[0]["primitives"]]}
            ]
        ),
        "mesh",
        points=UPRIGHT,
        warning=r"lines_beside_triangles.glb: left out: 1 primitives without faces",
    ),
    Case(
        "lines.glb",
        glb(meshes=primitive(mode=3)),
        "mesh",
        error=r"lines.glb: the mesh has no faces",
    ),
    Case(
        "indices_of_two_bytes.glb",
        glb(
            INDICES + FLOATS,
            bufferViews=views(INDICES, FLOATS),
            accessors=[
                vec3(1),
                {"bufferView": 0, "count": 3, "componentType": 5123, "type": "SCALAR"},
            ],
            meshes=primitive(indices=1),
        ),
        "mesh",
        points=UPRIGHT,
        area=0.5,
    ),
    Case(
        "index_beyond_its_part.glb",
        glb(
            struct.pack("<3H2x", 0, 1, 3) + FLOATS,
            bufferViews=views(INDICES, FLOATS),
            accessors=[
                vec3(1),
                {"bufferView": 0, "count": 3, "componentType": 5123, "type": "SCALAR"},
            ],
            meshes=[
                {
                    "primitives": [
                        *primitive(indices=1)[0]["primitives"],
                        *primitive()[0]["primitives"],
                    ]
                }
            ],
        ),
        "mesh",
        error=r"index_beyond_its_part.glb: a face refers to a vertex that does not exist",
    ),
    Case(
        "sparse.glb",  # its third point is another
        glb(
            FLOATS + MOVED_POINT,
            bufferViews=views(FLOATS, MOVED_POINT[:4], MOVED_POINT[4:]),
            accessors=[
                vec3(
                    0,
                    sparse={
                        "count": 1,
                        "indices": {"bufferView": 1, "componentType": 5123},
                        "values": {"bufferView": 2},
                    },
                )
            ],
        ),
        "mesh",
        points=[(0, 0, 0), (1, 0, 0), (0, 0, 5)],
        area=2.5,
    ),
    Case(
        "quantised_and_interleaved.glb",
        glb(
            QUANTISED,
            extensionsRequired=["KHR_mesh_quantization"],
            bufferViews=[{"buffer": 0, "byteLength": 24, "byteStride": 8}],
            accessors=[vec3(0, kind=5122, normalized=True)],
        ),
        "mesh",
        points=UPRIGHT,
    ),
    Case(
        "draco.glb",
        glb(extensionsRequired=["KHR_draco_mesh_compression"]),
        "mesh",
        error=r"draco.glb: KHR_draco_mesh_compression is not read",
    ),
    Case(
        "instanced_by_extension.glb",
        glb(nodes=[{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {}}}]),
        "mesh",
        error=r"instanced_by_extension.glb: EXT_mesh_gpu_instancing is not read",
    ),
    Case(
        "buffer_beside.glb",
        glb(buffers=[{"uri": "beside.bin", "byteLength": 36}]),
        "mesh",
        error=r"buffer_beside.glb: its buffers are not within it",
    ),
    Case(
        "second_buffer.glb",
        glb(bufferViews=[{"buffer": 1, "byteLength": 36}]),
        "mesh",
        error=r"second_buffer.glb: its buffers are not within it",
    ),
    Case(
        "node_within_itself.glb",
        glb(nodes=[{"mesh": 0, "children": [0]}]),
        "mesh",
        error=r"node_within_itself.glb: node 0 has two parents",
    ),
    *(
        Case(f"many_{name}.glb", glb(**changes), "mesh", error=rf"many_{name}.glb: ")
        for name, changes in {
            "zeros": {"accessors": [vec3(None, 10**9)]},
            "points": {"accessors": [vec3(0, 10**9)]},
            "more_than_there_are": {"accessors": [vec3(0, 4)]},
            "fewer_than_none": {"accessors": [vec3(0, -1)]},
        }.items()
    ),
    Case(
        "glTF_1.glb",
        content(struct.pack("<4sII", b"glTF", 1, 12)),
        "mesh",
        error=r"glTF_1.glb: glTF 1 is not read, only glTF 2",
    ),
    Case(
        "nested_json.glb",
        content(struct.pack("<4sIII4s", b"glTF", 2, 100_020, 100_000, b"JSON") + b"[" * 100_000),
        "mesh",
        error=r"nested_json.glb: not a readable GLB file \(nested too deeply\)",
    ),
]
