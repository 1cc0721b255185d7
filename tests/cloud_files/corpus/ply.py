"""PLY files, laid out by hand, and what lies beside them."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import struct
from collections.abc import Callable
from pathlib import Path

from pointkit.coding import zstandard
from tests.support.corpus_case import cloud_case as _case

_TEXT = "1 2 3\n4 5 6\n"
_FLOATS = struct.pack("<6f", 1, 2, 3, 4, 5, 6)


def _ply(
    body: str | bytes = _FLOATS,
    before: str = "",
    after: str = "",
    count: object = 2,
    kind: str = "float",
    form: str = "binary_little_endian",
) -> bytes:
    """Two vertices; before, after: lines of the header around the properties of the vertices."""
    axes = "".join(f"property {kind} {axis}\n" for axis in "xyz")
    head = f"ply\nformat {form} 1.0\n{before}element vertex {count}\n{axes}{after}end_header\n"
    return head.encode() + (body.encode() if isinstance(body, str) else body)


_ASCII = _ply(_TEXT, form="ascii")
_FACES = "element face {}\nproperty list uchar int vertex_indices\n"


def _beside(data: bytes, text: str) -> Callable[[Path], None]:
    """Writes a file and a JSON of these words beside it."""

    def write(path: Path) -> None:
        path.write_bytes(data)
        path.with_suffix(".json").write_text(text, encoding="utf-8")

    return write


_ZEROS = struct.pack("<30f", *[0.0] * 12, *range(1, 19))
_OURS = json.dumps({"puckbench": "cloud", "points": 10})

CASES = [
    _case("plain.ply", _ply()),
    _case("text.ply", _ASCII),
    _case("big_endian.ply", _ply(struct.pack(">6f", *range(1, 7)), form="binary_big_endian")),
    _case("integers.ply", _ply(struct.pack("<6h", *range(1, 7)), kind="short")),
    _case("types_with_bits.ply", _ply(struct.pack("<6d", *range(1, 7)), kind="float64")),
    _case("int16.ply", _ply(struct.pack("<6h", *range(1, 7)), kind="int16")),
    _case("uint8.ply", _ply(bytes(range(1, 7)), kind="uint8")),
    _case("cut_shorts.ply", _ply(bytes(11), kind="short"), error="truncated: its header says"),
    # Headers
    _case("blank_after_ply.ply", _ply().replace(b"ply\n", b"ply \n", 1)),
    _case("blank_after_end.ply", _ply().replace(b"end_header\n", b"end_header \n")),
    _case("blanks_in_text.ply", _ASCII.replace(b"end_header\n", b"end_header\t \n")),
    _case("comment_in_latin_1.ply", _ply(before="comment by #\n").replace(b"#", b"Andr\xe9")),
    _case("comment_in_utf_8.ply", _ply(before="comment größer\nobj_info num_cols 512\n")),
    *(
        _case(
            f"name_in_{encoding}.ply",
            _ply("1 2 3 7\n4 5 6 8\n", after="property float Intensit@\n", form="ascii").replace(
                b"@", "ät".encode(encoding)
            ),
            fields={"Intensitat": [7, 8]},
        )
        for encoding in ("utf-8", "latin-1")
    ),
    _case("more_points.ply", _ply(_FLOATS * 2), warning="left out 24 bytes after its 2 vertex"),
    _case(
        "more_lines.ply",
        _ply(_TEXT + "7 8 9\n\n", form="ascii"),
        warning="left out 1 lines after its 2 lines",
    ),
    _case("decimal_comma.ply", _ply("1,5 2,5 3,5\n4 5 6\n", form="ascii"), error="malformed input"),
    _case(
        "case_of_names.ply",
        _ply("1 2 3 7 9\n4 5 6 8 9\n", form="ascii").replace(
            b"end_header", b"property int Ring\nproperty int ring\nend_header"
        ),
        fields={"Ring": [7, 8], "ring": [9, 9]},
    ),
    _case("crlf.ply", _ply(body=b"").replace(b"\n", b"\r\n") + _FLOATS),
    _case("crlf_and_blank.ply", _ply(b"", "comment é\n").replace(b"\n", b"\r\n") + _FLOATS),
    _case("crlf_text.ply", _ASCII.replace(b"\n", b"\r\n")),
    _case(
        "crlf_text_and_blank.ply", _ply(_TEXT, "comment é\n", form="ascii").replace(b"\n", b"\r\n")
    ),
    _case("cr.ply", _ply(body=b"").replace(b"\n", b"\r") + _FLOATS),
    _case("cr_and_blank.ply", _ply(b"", "comment é\n").replace(b"\n", b"\r") + _FLOATS),
    _case("two_blanks.ply", _ply().replace(b"element vertex", b"element  vertex")),
    _case("long_comments.ply", _ply(before=f"comment {'x' * 90}\n" * 2000)),
    _case("no_faces.ply", _ply(after=_FACES.format(0))),
    _case(
        "camera_before.ply",
        _ply(struct.pack("<f", 9) + _FLOATS, "element camera 1\nproperty float far\n"),
    ),
    # Properties
    _case(
        "list_of_a_vertex.ply",
        _ply("1 2 3 2 8 9\n4 5 6 0\n", after="property list uchar int rays\n", form="ascii"),
        warning="list_of_a_vertex.ply: lists of vertices are left out: rays",
    ),
    _case(
        "rgb_big_endian.ply",
        _ply(
            struct.pack(">3fI3fI", 1, 2, 3, 0x010203, 4, 5, 6, 0x0A0B0C),
            after="property uint rgb\nproperty uchar ring\n".replace("property uchar ring\n", ""),
            form="binary_big_endian",
        ),
    ),
    _case(
        "wide_colours.ply",
        _ply(
            "1 2 3 256 512 65535\n4 5 6 0 1 2\n",
            after="".join(f"property ushort {name}\n" for name in ("red", "green", "blue")),
            form="ascii",
        ),
        fields={"red_16": [256, 0], "blue_16": [65535, 2]},
    ),
    # Refused
    _case("empty.ply", b"", error="not a readable PLY file"),
    _case("no_points.ply", _ply(b"", count=0), error="the cloud is empty"),
    _case(
        "mesh.ply",
        _ply(_FLOATS + b"\3" + bytes(12), after=_FACES.format(1)),
        error="a mesh, not a cloud",
    ),
    _case(
        "same_name.ply",
        _ply(struct.pack("<8f", *range(8)), after="property float x\n"),
        error="not a readable PLY file",
    ),
    _case("cut.ply", _ply()[:-1], error="truncated: its header says 2 of vertex"),
    _case("cut_text.ply", _ply("1 2 3\n4 5", form="ascii"), error="not a readable PLY file"),
    _case("cut_header.ply", _ply()[:60], error="no header"),
    _case("claims_much.ply", _ply(count=10**12), error="truncated: its header says 1000000000000"),
    _case(
        "claims_much_text.ply",
        _ply(_TEXT, count=10**12, form="ascii"),
        error="truncated: its header",
    ),
    _case(
        "claims_much_of_nothing.ply",
        _ply(before="element odd 1000000000\n"),
        error="not a readable PLY header",
    ),
    _case("negative.ply", _ply(count=-1), error="not a readable PLY header"),
    _case("count_in_words.ply", _ply(count="two"), error="not a readable PLY header"),
    _case("unknown_type.ply", _ply(kind="quaternion"), error="not a readable PLY header"),
    _case(
        "pointer.ply", b"version https://git-lfs.github.com/spec/v1\n", error="a Git-LFS pointer"
    ),
    # Compressed
    _case("packed.ply.gz", gzip.compress(_ply())),
    _case("packed.ply.bz2", bz2.compress(_ASCII)),
    _case("packed.ply.xz", lzma.compress(_ply(before="comment é\n"))),
    _case("packed.ply.zst", zstandard.compressed(_ply())),
    _case("packed.xyz.gz", gzip.compress(b"1 2 3\n4 5 6\n")),
    _case(
        "packed_cut.ply.gz",
        gzip.compress(_ply())[:-9],
        error="packed_cut.ply.gz: damaged compressed file",
    ),
    _case("packed_not.ply.gz", _ply(), error="packed_not.ply.gz: damaged compressed file"),
    # Missing returns, and what lies beside
    _case(
        "zeros.ply",
        _ply(_ZEROS, count=10),
        [(x, x + 1, x + 2) for x in range(1, 19, 3)],
        warning="zeros.ply: 4 of 10 points are missing returns .--keep-missing keeps them",
    ),
    _case(
        "zeros_kept.ply",
        _ply(_ZEROS, count=10),
        [(0, 0, 0)] * 4 + [(x, x + 1, x + 2) for x in range(1, 19, 3)],
        options={"keep_missing": True},
    ),
    _case(
        "zeros_of_ours.ply",
        _beside(_ply(_ZEROS, count=10), _OURS),
        [(0, 0, 0)] * 4 + [(x, x + 1, x + 2) for x in range(1, 19, 3)],
    ),
    _case(
        "two_zeros.ply",
        _ply(struct.pack("<12f", *[0.0] * 6, *range(6)), count=4),
        [(0, 0, 0), (0, 0, 0), (0, 1, 2), (3, 4, 5)],
    ),
    _case(
        "coarse.ply",
        _ply(struct.pack("<15f", *[0.0] * 9, *[1.0] * 6), count=5),
        [(0, 0, 0)] * 3 + [(1, 1, 1)] * 2,
    ),
    _case("one_place.ply", _ply(bytes(48), count=4), [(0, 0, 0)] * 4),
    _case(
        "foreign_json.ply",
        _beside(_ply(), '{"size": 4, "scale": 9}'),
        warning="foreign_json.json beside it is not its description",
    ),
    _case(
        "foreign_list.ply",
        _beside(_ply(), "[1, 2]"),
        warning="foreign_list.json beside it is not its description",
    ),
    _case(
        "broken_json.ply",
        _beside(_ply(), "{"),
        warning="broken_json.json beside it is not its description",
    ),
    _case(
        "other_count.ply",
        _beside(_ply(), _OURS),
        warning="2 points, but other_count.json beside it describes a file of 10 points: not used",
    ),
]
