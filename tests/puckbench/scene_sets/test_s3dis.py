"""Rooms in the layout of S3DIS, with the damage that the real release has."""

from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.scene_sets.s3dis import S3DIS
from puckbench.scene_sets.xyzrgb import read_xyzrgb
from tests.support.files import put

CLEAN = b"1.5 2 3 10 20 30\n-4.25 5 6e-1 255.000000 0 87.000000\n"


def read(tmp_path: Path, data: bytes) -> tuple[list[list[float]], list[list[int]], int, int]:
    path = tmp_path / "room.txt"
    path.write_bytes(data)
    text = read_xyzrgb(path)
    return text.xyz.tolist(), text.colours.tolist(), text.repaired, text.dropped


@pytest.mark.parametrize(
    "data", [CLEAN, CLEAN.replace(b"\n", b"\r\n"), CLEAN.replace(b" ", b" \t"), b"\n" + CLEAN[:-1]]
)
def test_clean_lines_in_every_spelling(tmp_path: Path, data: bytes) -> None:
    xyz, colours, repaired, dropped = read(tmp_path, data)
    assert xyz == [[1.5, 2, 3], [-4.25, 5, 0.6]]
    assert colours == [[10, 20, 30], [255, 0, 87]]
    assert (repaired, dropped) == (0, 0)


def test_three_decimals_are_read_to_the_nearest_double(tmp_path: Path) -> None:
    values = np.random.default_rng(1).integers(-30_000, 30_000, (3000, 3)) / 1000
    lines = [f"{x:.3f} {y:.3f} {z:.3f} 1 2 3\n" for x, y, z in values.tolist()]
    assert read(tmp_path, "".join(lines).encode())[0] == values.tolist()


DAMAGE = {
    "inside a number": (b"7.1\x105 2 3 1 2 3", [7.105, 2, 3], [1, 2, 3]),
    "two bytes inside a number": (b"7.\x00\x005 2 3 1 2 3", [7.005, 2, 3], [1, 2, 3]),
    "instead of a space": (b"7 2 3 185\x10187 3", [7, 2, 3], [185, 187, 3]),
    "instead of a space and inside": (b"7.\x101 2\x103 185 187 3", [7.01, 2, 3], [185, 187, 3]),
    "beside a space": (b"7 \x10 2 3 1 2\xff 3", [7, 2, 3], [1, 2, 3]),
    "at the ends": (b"\x007 2 3 1 2 3\x00", [7, 2, 3], [1, 2, 3]),
}


@pytest.mark.parametrize("name", DAMAGE)
@pytest.mark.parametrize("after", [CLEAN, b""])
def test_a_damaged_line_is_repaired(tmp_path: Path, name: str, after: bytes) -> None:
    line, position, colour = DAMAGE[name]
    xyz, colours, repaired, dropped = read(tmp_path, CLEAN + line + b"\n" + after)
    assert xyz[2] == position
    assert colours[2] == colour
    assert (xyz[:2], xyz[3:]) == (
        [[1.5, 2, 3], [-4.25, 5, 0.6]],
        [[1.5, 2, 3], [-4.25, 5, 0.6]][: len(after)],
    )
    assert (repaired, dropped) == (1, 0)


LOST = [
    b"1 2 3 4 5",
    b"1 2 3 4 5 6 7",
    b"1 2 3 4 5 256",
    b"1 2 3 -1 5 6",
    b"1 2 3 4 5.5.5 6",
    b"1 2 - 4 5 6",
    b"1 nan 3 4 5 6",
    b"1 2 3 \x10 5 6",
    b"\x00" * 40,
    b"1e999 2 3 4 5 6",
    b"a 1 b 2 c 3 d 4 e 5 f 6 g h i j",
]


@pytest.mark.parametrize("line", LOST)
@pytest.mark.parametrize("first", [True, False])
def test_a_line_that_cannot_be_read_is_dropped_and_counted(
    tmp_path: Path, line: bytes, first: bool
) -> None:
    parts = [line + b"\n", CLEAN] if first else [CLEAN, line]
    xyz, _, repaired, dropped = read(tmp_path, b"".join(parts))
    assert xyz == [[1.5, 2, 3], [-4.25, 5, 0.6]]
    assert (repaired, dropped) == (0, 1)


@pytest.mark.parametrize("data", [b"", b"\n\n", b"x y z r g b\n", b"1 2 3\n" * 5])
def test_a_file_without_a_readable_line_is_an_error(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(InputError, match=r"room\.txt: no lines of x y z r g b"):
        read(tmp_path, data)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Two areas with the damage of the release: a misnamed room."""
    line = "{} 2 3 10 20 30\n"
    files = {
        "Area_1/office_1/office_1.txt": line.format(1) * 3,
        "Area_1/office_1/Annotations/wall_1.txt": line.format(1) * 2,
        "Area_1/office_1/.DS_Store": "Bud1",
        "Area_1/.DS_Store": "Bud1",
        "Area_1/Area_1_alignmentAngle.txt": "office_1 90\n",
        "Area_6/copyRoom_1/copy_Room_1.txt": line.format(5),
        "Area_6/hallway_2/hallway_2.txt": line.format(6) + "7\x10 2 3 10 20 30\n1 2\n",
        ".DS_Store": "Bud1",
    }
    for name, text in files.items():
        put(tmp_path / name, text)
    return tmp_path


def test_rooms_of_all_areas_or_of_some(tree: Path) -> None:
    rooms = S3DIS(path=str(tree))
    assert rooms.names() == ["Area_1_office_1", "Area_6_copyRoom_1", "Area_6_hallway_2"]
    assert S3DIS(path=str(tree), areas=("Area_1",)).names() == ["Area_1_office_1"]
    with pytest.raises(InputError, match=r"unknown name 'Area_2' \(known: Area_1, Area_6\)"):
        S3DIS(path=str(tree), areas=("Area_2",)).names()


def test_rooms_are_counted_against_the_release(tree: Path) -> None:
    counts = {count.what: count for count in S3DIS(path=str(tree), areas=("Area_1",)).counts()}
    assert sum(count.published for count in counts.values()) == 272
    assert counts["Area_6"].line() == "2 of 48 published, which differs"
    assert counts["Area_2"].held == 0


def test_a_raw_room_needs_no_annotations(tree: Path) -> None:
    scene = S3DIS(path=str(tree)).load("Area_6_hallway_2")
    assert scene.cloud is not None
    assert scene.box is not None
    assert scene.cloud.xyz[:, 0].tolist() == [6, 7]
    assert scene.cloud.labels is None
    assert scene.box.tolist() == [[6, 2, 3], [7, 2, 3]]
    assert scene.group == "hallway"
    assert scene.about["repaired_lines"] == {"hallway_2.txt": 1}
    assert scene.about["dropped_lines"] == {"hallway_2.txt": 1}
    assert not scene.about["aligned"]


def test_the_known_damage_of_the_release_is_handled_and_told(tree: Path) -> None:
    raw = S3DIS(path=str(tree)).load("Area_6_copyRoom_1")
    assert raw.about["misnamed"] == "copy_Room_1.txt"
    assert S3DIS(path=str(tree)).load("Area_1_office_1").about["aligned"]


def test_missing_files_of_a_room_are_named(tree: Path) -> None:
    (tree / "Area_6" / "copyRoom_1" / "other.txt").write_text("")
    with pytest.raises(InputError, match=r"no copyRoom_1\.txt, but 2 other text files"):
        S3DIS(path=str(tree)).load("Area_6_copyRoom_1")
