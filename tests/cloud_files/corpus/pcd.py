"""PCD files, laid out by hand after PCL's description of the format."""

from __future__ import annotations

import struct

import lzf
import numpy as np

from tests.support.corpus_case import TWO
from tests.support.corpus_case import cloud_case as _case

_FLOATS = struct.pack("<6f", 1, 2, 3, 4, 5, 6)
_TEXT = b"1 2 3\n4 5 6\n"
_NAN = float("nan")


def _pcd(body: bytes = _FLOATS, form: str = "binary", more: str = "", **lines: str) -> bytes:
    """A file of x, y, z; lines: those of the header that differ, left out where empty."""
    header = {
        "VERSION": "0.7",
        "FIELDS": "x y z",
        "SIZE": "4 4 4",
        "TYPE": "F F F",
        "COUNT": "1 1 1",
        "WIDTH": "2",
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": "2",
    } | lines
    text = "".join(f"{name} {words}\n" for name, words in header.items() if words)
    return f"# .PCD v0.7\n{more}{text}DATA {form}\n".encode() + body


def _fields(fields: str, sizes: str, types: str, counts: str) -> dict[str, str]:
    return {"FIELDS": fields, "SIZE": sizes, "TYPE": types, "COUNT": counts}


def _packed(plain: bytes, size: int | None = None) -> bytes:
    packed = lzf.compress(plain)
    return struct.pack("<II", len(packed), len(plain) if size is None else size) + packed


_COLUMNS = np.array(TWO, dtype="<f4").T.tobytes() + bytes(400)
"""x, then y, then z, then 200 bytes of a field for each point."""
_PADDED = _fields("x y z _", "4 4 4 1", "F F F U", "1 1 1 200")


_IMAGE = {"WIDTH": "2", "HEIGHT": "2", "POINTS": "4"}

CASES = [
    _case("plain.pcd", _pcd()),
    _case("text.pcd", _pcd(_TEXT, "ascii")),
    _case("compressed.pcd", _pcd(_packed(_COLUMNS), "binary_compressed", **_PADDED)),
    _case("crlf.pcd", _pcd(b"").replace(b"\n", b"\r\n") + _FLOATS),
    _case("crlf_text.pcd", _pcd(_TEXT, "ascii").replace(b"\n", b"\r\n")),
    *(
        _case(
            f"name_in_{encoding}.pcd",
            _pcd(
                b"1 2 3 7\n4 5 6 8\n", "ascii", **_fields("x y z @", "4 4 4 4", "F F F F", "1 " * 4)
            ).replace(b"@", "Intensität".encode(encoding)),
            fields={"Intensität": [7, 8]},
        )
        for encoding in ("utf-8", "latin-1")
    ),
    _case(
        "decimal_comma.pcd", _pcd(b"1,5 2,5 3,5\n4 5 6\n", "ascii"), error="a damaged line .*'1,5'"
    ),
    _case(
        "same_part.pcd",
        _pcd(
            b"1 2 3 7 7 9\n4 5 6 8 8 9\n",
            "ascii",
            **_fields("x y z d d_0", "4 " * 5, "F " * 5, "1 1 1 2 1"),
        ),
        fields={"d_0": [9, 9], "d_0_": [7, 8], "d_1": [7, 8]},
    ),
    _case("no_viewpoint.pcd", _pcd(VIEWPOINT="")),
    _case("no_points_line.pcd", _pcd(POINTS="")),
    _case("no_counts.pcd", _pcd(COUNT="")),
    _case("comments.pcd", _pcd(more="# one\n# two\n")),
    _case("field_of_no_values.pcd", _pcd(**_fields("x y rgb z", "4 4 4 4", "F F F F", "1 1 0 1"))),
    _case(
        "field_of_values.pcd",
        _pcd(
            struct.pack("<3f2H3f2H", 1, 2, 3, 7, 8, 4, 5, 6, 9, 10),
            **_fields("x y z pair", "4 4 4 2", "F F F U", "1 1 1 2"),
        ),
        fields={"pair_0": [7, 9], "pair_1": [8, 10]},
    ),
    _case(
        "gaps.pcd",
        _pcd(
            struct.pack("<3fI3fI", 1, 2, 3, 9, 4, 5, 6, 9),
            **_fields("x y z _", "4 4 4 4", "F F F U", "1 1 1 1"),
        ),
    ),
    _case(
        "other_size_of_image.pcd",
        _pcd(WIDTH="3"),
        warning="other_size_of_image.pcd: POINTS says 2 .3 in WIDTH x HEIGHT.",
    ),
    _case(
        "more_than_said.pcd",
        _pcd(_FLOATS * 2),
        warning="POINTS says 2 .4 in the data.: the first 2",
    ),
    # Images with pixels that have no return
    _case(
        "zeros.pcd",
        _pcd(_FLOATS + bytes(24), **_IMAGE),
        warning="zeros.pcd: 2 of 4 points are missing returns",
    ),
    _case(
        "one_zero.pcd",
        _pcd(struct.pack("<12f", 1, 2, 3, 0, 0, 0, 4, 5, 6, 7, 8, 9), **_IMAGE),
        [*TWO, (7, 8, 9)],
        warning="one_zero.pcd: 1 of 4 points are missing returns",
    ),
    _case(
        "nan.pcd",
        _pcd(_FLOATS + struct.pack("<6f", *[_NAN] * 6), **_IMAGE),
        warning="nan.pcd: 2 of 4 points are missing returns",
    ),
    _case(
        "nan_text.pcd",
        _pcd(b"nan nan nan\n1 2 3\nnan nan nan\n4 5 6\n", "ascii", **_IMAGE),
        warning="nan_text.pcd: 2 of 4 points are missing returns",
    ),
    _case(
        "zeros_kept.pcd",
        _pcd(_FLOATS + bytes(24), **_IMAGE),
        [*TWO, (0, 0, 0), (0, 0, 0)],
        options={"keep_missing": True},
    ),
    _case(
        "zeros_of_no_image.pcd",
        _pcd(_FLOATS + bytes(24), WIDTH="4", POINTS="4"),
        [*TWO, (0, 0, 0), (0, 0, 0)],
    ),
    _case(
        "all_zeros.pcd", _pcd(bytes(48), **_IMAGE), error="all of its 4 points are missing returns"
    ),
    _case(
        "half_nan.pcd",
        _pcd(struct.pack("<6f", 1, _NAN, 3, 4, 5, 6)),
        error="1 of 2 points are not finite .*--drop-invalid",
    ),
    # Refused
    _case("empty.pcd", b"", error="not a PCD file"),
    _case("cut.pcd", _pcd()[:-1], error="has 1 points, but its header says 2"),
    _case("no_points.pcd", _pcd(b"", WIDTH="0", POINTS="0"), error="header says 0$"),
    _case(
        "no_fields.pcd",
        _pcd(b"", **_fields("x y z", "4 4 4", "F F F", "0 0 0")),
        error="the PCD file has no fields",
    ),
    _case(
        "same_name.pcd",
        _pcd(**_fields("x y x", "4 4 4", "F F F", "1 1 1")),
        error="not a readable PCD header",
    ),
    _case(
        "big_count.pcd",
        _pcd(COUNT="1 1 4097"),
        error="PCD header .4097 values in a field",
    ),
    _case("negative_count.pcd", _pcd(COUNT="1 1 -1"), error="not a readable PCD header"),
    _case("fewer_sizes.pcd", _pcd(SIZE="4 4"), error="not a readable PCD header"),
    _case("huge_size.pcd", _pcd(SIZE="4 4 4000000000"), error="not a readable PCD header"),
    _case("claims_much.pcd", _pcd(POINTS="1000000000000"), error="header says 1000000000000$"),
    _case(
        "compressed_less.pcd",
        _pcd(_packed(_COLUMNS[:300], len(_COLUMNS)), "binary_compressed", **_PADDED),
        error="damaged compressed points",
    ),
    _case("no_number.pcd", _pcd(POINTS="", HEIGHT=""), error="header says 0$"),
    _case("no_form.pcd", _pcd(form="zipped"), error="PCD data of the form zipped"),
    _case("damaged_text.pcd", _pcd(b"1 2 3\n4 5 six\n", "ascii"), error="a damaged line"),
    _case(
        "compressed_cut.pcd",
        _pcd(_packed(_COLUMNS)[:-4], "binary_compressed", **_PADDED),
        error="damaged compressed points",
    ),
    _case(
        "compressed_other_size.pcd",
        _pcd(_packed(_COLUMNS, 9), "binary_compressed", **_PADDED),
        error="has 9 bytes for 2 points",
    ),
    _case(
        "compressed_bomb.pcd",
        _pcd(
            _packed(b"\0" * 24, 2_400_000_000),
            "binary_compressed",
            POINTS="200000000",
            WIDTH="200000000",
        ),
        error="bytes for \\d+ points",
    ),
]
