"""A PLY file is too short for its header, or is not, to the row."""

from __future__ import annotations

from pathlib import Path

import pytest

from puckbench.core.errors import InputError
from puckbench.io.ply_header import check_counts

# Names of the format's first description and of later programs, with their bytes.
SIZES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "float", "int32", "uint32", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}
ROWS = 200


def ply(path: Path, kind: str, missing: int = 0, form: str = "binary_little_endian") -> Path:
    """Rows of one property, which may end before the last of them."""
    head = f"ply\nformat {form} 1.0\nelement vertex {ROWS}\nproperty {kind} x\nend_header\n"
    row = b"0\n" if form == "ascii" else bytes(SIZES[kind.replace("list ", "").split()[0]])
    path.write_bytes(head.encode() + row * (ROWS - missing))
    return path


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", [*SIZES, "list uchar int", "list int double"])
def test_rows_that_do_not_fit_are_refused(tmp_path: Path, kind: str, form: str) -> None:
    check_counts(ply(tmp_path / "a.ply", kind, form=form))
    with pytest.raises(InputError, match=r"a\.ply: .*200 rows of 'vertex' do not fit in \d+ bytes"):
        check_counts(ply(tmp_path / "a.ply", kind, missing=15, form=form))


def test_a_last_line_without_an_end_fits(tmp_path: Path) -> None:
    path = ply(tmp_path / "a.ply", "float", form="ascii")
    path.write_bytes(path.read_bytes()[:-1])
    check_counts(path)


def test_each_element_counts_with_its_properties(tmp_path: Path) -> None:
    head = "element vertex 2\nproperty double x\nproperty double y\nelement face 40\n"
    path = tmp_path / "a.ply"
    path.write_text(f"ply\nformat binary_little_endian 1.0\n{head}property char a\nend_header\n")
    with pytest.raises(InputError, match="2 rows of 'vertex' do not fit in 11 bytes"):
        check_counts(path)
    path.write_bytes(path.read_bytes() + bytes(21))
    with pytest.raises(InputError, match="40 rows of 'face' do not fit in 32 bytes"):
        check_counts(path)
    path.write_bytes(path.read_bytes() + bytes(11))
    check_counts(path)


def test_what_is_not_understood_is_left_to_the_reader(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    for text in ("", "no PLY", "element vertex\nproperty\nproperty list\nelement vertex many\n"):
        path.write_text(text)
        check_counts(path)
    path.write_text("element vertex 1000\nproperty strange x\nproperty int\n")
    with pytest.raises(InputError, match="1000 rows of 'vertex' do not fit"):
        check_counts(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.ply: no such file"):
        check_counts(tmp_path / "none.ply")
