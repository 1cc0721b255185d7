"""PLY files that are too short for their headers."""

from __future__ import annotations

from pathlib import Path

import pytest

from cloud_files.ply import read_elements
from pointkit.errors import InputError

# Names of the format's first description and of later programs, with their bytes.
SIZES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "float", "int32", "uint32", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}
ROWS = 200


def ply(path: Path, kind: str, missing: int = 0, form: str = "binary_little_endian") -> Path:
    """A file of rows of one property, some missing."""
    head = f"ply\nformat {form} 1.0\nelement vertex {ROWS}\nproperty {kind} x\nend_header\n"
    row = b"0\n" if form == "ascii" else bytes(SIZES[kind.replace("list ", "").split()[0]])
    path.write_bytes(head.encode() + row * (ROWS - missing))
    return path


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", [*SIZES, "list uchar int", "list int double"])
def test_rows_that_do_not_fit_are_refused(tmp_path: Path, kind: str, form: str) -> None:
    read_elements(ply(tmp_path / "a.ply", kind, form=form))
    with pytest.raises(InputError, match=r"a\.ply: .*its header says 200 of vertex"):
        read_elements(ply(tmp_path / "a.ply", kind, missing=15, form=form))


def test_a_last_line_without_an_end_fits(tmp_path: Path) -> None:
    path = ply(tmp_path / "a.ply", "float", form="ascii")
    path.write_bytes(path.read_bytes()[:-1])
    read_elements(path)


def test_each_element_counts_with_its_properties(tmp_path: Path) -> None:
    head = "element vertex 2\nproperty double x\nproperty double y\nelement face 40\n"
    path = tmp_path / "a.ply"
    path.write_text(f"ply\nformat binary_little_endian 1.0\n{head}property char a\nend_header\n")
    with pytest.raises(InputError, match="its header says 2 of vertex, 40 of face"):
        read_elements(path)
    path.write_bytes(path.read_bytes() + bytes(2 * 16 + 40 - 1))
    with pytest.raises(InputError, match="its header says 2 of vertex, 40 of face"):
        read_elements(path)
    path.write_bytes(path.read_bytes() + bytes(1))
    read_elements(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.ply: no such file"):
        read_elements(tmp_path / "none.ply")
