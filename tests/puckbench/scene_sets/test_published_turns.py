"""Consecutive turns that others published: their download, and the loaders that read them."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.cli import main
from puckbench.scene_sets import published_files
from puckbench.scene_sets.inter_lpcm import InterLpcm
from puckbench.scene_sets.kitti import Kitti
from puckbench.scene_sets.sfnd_lidar import SfndLidar
from puckbench.scene_sets.sources import SOURCES
from tests.support.file_server import served_answer, served_files
from tests.support.files import put
from tests.support.kitti_frames import as_kitti, hdl64

SETS = {"sfnd_lidar_1": 22, "sfnd_lidar_2": 154, "sfnd_tracking": 78, "inter_lpcm_turns": 20}
COMMIT = "ef15da2bc172359e7d6edfdd156a2a243d10977e"
PLACE = "src/sensors/data/pcd/data_1"
TURNS = {"data_1/0000000000.pcd": b"first turn", "data_1/0000000001.pcd": b"second"}


def pcd(rows: np.ndarray, points: int | None = None) -> bytes:
    """A file as PCL writes it: x, y, z and intensity as float32."""
    count = len(rows) if points is None else points
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z intensity\n"
        f"SIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {count}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )
    return header.encode() + rows.astype("<f4").tobytes()


@pytest.mark.parametrize("name", SETS)
def test_tables_have_the_size_and_hash_of_every_turn(name: str) -> None:
    table = published_files.published(name)
    turns = [file for file in table["files"] if file.endswith((".pcd", ".bin"))]
    turns = [file for file in turns if "matrix" not in file]
    assert len(turns) == SETS[name]
    numbers = [int(Path(file).stem) for file in turns]
    assert numbers == list(range(numbers[0], numbers[0] + SETS[name]))
    for entry in table["files"].values():
        assert re.fullmatch("[0-9a-f]{64}", entry["sha256"])
        assert entry["bytes"] > 0
    (address,) = table["repositories"].values()
    assert re.fullmatch(r"[\w-]+/[\w-]+/[0-9a-f]{40}", address)
    assert "CC BY-NC-SA 3.0" in SOURCES[name].credits(Path())
    assert "not commercial" in SOURCES[name].terms()


@pytest.fixture
def table(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The table of sfnd_lidar_1 with two small files, in the place of the real one."""
    files = {
        name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in TURNS.items()
    }
    result = {
        "repositories": {"lidar": f"udacity/SFND_Lidar_Obstacle_Detection/{COMMIT}"},
        "within": "lidar/src/sensors/data/pcd",
        "files": files,
    }
    _use(monkeypatch, from_clone=partial(published_files.from_clone, table=result, name="turns"))
    return result


def _use(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    monkeypatch.setitem(SOURCES, "sfnd_lidar_1", replace(SOURCES["sfnd_lidar_1"], **changes))


@pytest.fixture
def server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, table: dict[str, Any]
) -> Iterator[Path]:
    """The folder of the repository's files on a server on this machine."""
    with served_files(tmp_path / "served") as address:
        folder = tmp_path / "served" / table["repositories"]["lidar"] / "src/sensors/data/pcd"
        for name, content in TURNS.items():
            put(folder / name, content)
        given = {"host": address, "table": table, "name": "turns"}
        _use(monkeypatch, download=partial(published_files.download, **given))
        yield folder


def test_turns_are_downloaded_into_their_folder_and_the_licence_is_told(
    server: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert server.is_dir()
    command = ["data", "sfnd_lidar_1", "--folder", str(tmp_path / "data")]
    for state in ("fetched", "present"):
        assert main(command) == 0
        printed = capsys.readouterr().out
        assert f"{state}: " in printed
        assert "not commercial: CC BY-NC-SA 3.0" in printed
    folder = tmp_path / "data" / "sfnd_lidar_1"
    assert {name: (folder / name).read_bytes() for name in TURNS} == TURNS
    assert SfndLidar(path=str(folder)).names() == ["data_1_0000000000", "data_1_0000000001"]
    (folder / "data_1" / "0000000001.pcd").write_bytes(b"damaged")
    assert main(command) == 0
    assert "fetched: " in capsys.readouterr().out
    assert (folder / "data_1" / "0000000001.pcd").read_bytes() == b"second"


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"first", r"data_1/0000000000\.pcd has 5 bytes, not the expected 10"),
        (b"other turn", r"data_1/0000000000\.pcd has the SHA-256 .*, not the expected"),
        (None, r"0000000000\.pcd cannot be fetched \("),
    ],
)
def test_a_damaged_download_is_one_line_and_leaves_nothing(
    server: Path,
    content: bytes | None,
    fault: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = server / "data_1" / "0000000000.pcd"
    path.unlink() if content is None else path.write_bytes(content)
    assert main(["data", "sfnd_lidar_1", "--folder", str(tmp_path / "data")]) == 2
    assert len(printed := capsys.readouterr().err.splitlines()) == 1
    assert re.search(fault, printed[0])
    assert list((tmp_path / "data").iterdir()) == []


@pytest.mark.parametrize(
    ("answer", "fault"),
    [
        (b"nonsense\r\n\r\n", r"0000000000\.pcd cannot be fetched \(nonsense"),
        (
            b"HTTP/1.0 200 OK\r\nContent-Length: 10\r\n\r\nfir",
            r"data_1/0000000000\.pcd has 3 bytes, not the expected 10",
        ),
    ],
)
def test_an_answer_that_is_no_file_is_named(
    table: dict[str, Any], answer: bytes, fault: str, tmp_path: Path
) -> None:
    with served_answer(answer) as host, pytest.raises(InputError, match=fault):
        published_files.download(tmp_path, host, table)


@pytest.mark.usefixtures("table")
@pytest.mark.parametrize("place", ["clones/SFND_Lidar_Obstacle_Detection", "clones"])
def test_turns_come_from_a_clone(place: str, tmp_path: Path) -> None:
    """The path is a clone, or a folder with clones."""
    for name, content in TURNS.items():
        put(tmp_path / place / "src/sensors/data/pcd" / name, content)
    command = ["data", "sfnd_lidar_1", "--folder", str(tmp_path / "data"), "--from"]
    assert main([*command, str(tmp_path / "clones")]) == 0
    for name, content in TURNS.items():
        assert (tmp_path / "data" / "sfnd_lidar_1" / name).read_bytes() == content


@pytest.mark.usefixtures("table")
@pytest.mark.parametrize(
    ("name", "content", "fault"),
    [
        (
            "sfnd_lidar_1",
            None,
            f"no file {PLACE}/0000000000.pcd (expected a clone of "
            "github.com/udacity/SFND_Lidar_Obstacle_Detection at ef15da2b)",
        ),
        ("sfnd_lidar_1", b"first turn of another commit", "has 28 bytes, not the expected 10"),
        (
            "sfnd_lidar_1",
            b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n",
            "a Git-LFS pointer",
        ),
        ("sweethome3d", None, "sweethome3d: a package of npm or Debian, which is in no clone"),
    ],
)
def test_what_is_no_clone_is_one_line_and_leaves_nothing(
    name: str,
    content: bytes | None,
    fault: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    clone = tmp_path / "clone"
    if content is not None:
        put(clone / PLACE / "0000000000.pcd", content)
    command = ["data", name, "--folder", str(tmp_path / "data"), "--from", str(clone)]
    assert main(command) == 2
    assert len(printed := capsys.readouterr().err.splitlines()) == 1
    assert fault in printed[0]
    assert not list((tmp_path / "data").glob("*"))


def test_a_pcd_turn_gives_the_returns_of_the_same_points_in_kitti_s_file(tmp_path: Path) -> None:
    data = as_kitti(hdl64(60))
    rows = np.frombuffer(data, "<f4").reshape(-1, 4)
    put(tmp_path / "data_2" / "0000000007.pcd", pcd(rows))
    put(tmp_path / "training" / "velodyne" / "000000.bin", data)
    own = SfndLidar(path=str(tmp_path), returns=True)
    scene = own.load("data_2_0000000007")
    same = Kitti(path=str(tmp_path), returns=True).load("training_000000")
    assert scene.returns is not None
    assert same.returns is not None
    assert scene.group == "data_2"
    assert scene.returns.beams == same.returns.beams
    np.testing.assert_array_equal(scene.returns.points(), same.returns.points())
    assert scene.about["source"] == "SFND_Lidar_Obstacle_Detection data_2/0000000007.pcd"
    cloud = SfndLidar(path=str(tmp_path)).load("data_2_0000000007").cloud
    assert cloud is not None
    np.testing.assert_array_equal(cloud.xyz, rows[:, :3].astype(np.float64))
    assert [count.line() for count in own.counts()] == ["1 of 154 published, which differs"]


def test_the_point_that_the_conversion_left_is_dropped_without_a_word(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """So PCL's padding with zeros, which fills up the page of the header."""
    rows = np.frombuffer(as_kitti(hdl64(60)), "<f4").reshape(-1, 4)
    data = pcd(np.vstack([rows, np.zeros((1, 4))]))
    header = data.index(b"DATA binary\n") + len(b"DATA binary\n")
    put(tmp_path / "data_1" / "0000000000.pcd", data + bytes(4096 - header))
    scene = SfndLidar(path=str(tmp_path), returns=True).load("data_1_0000000000")
    assert scene.returns is not None
    assert len(scene.returns) == len(rows)
    assert scene.about["dropped_points"] == 1
    assert not caplog.records


def test_a_turn_that_is_cut_off_has_no_returns_but_points(tmp_path: Path) -> None:
    rows = np.frombuffer(as_kitti(hdl64(60)), "<f4").reshape(-1, 4)[:2000]
    put(tmp_path / "src/sensors/data/pcd/data_2/0000000153.pcd", pcd(rows))
    with pytest.raises(InputError, match=r"0000000153\.pcd: \d+ rings, not 64"):
        SfndLidar(path=str(tmp_path), returns=True).load("data_2_0000000153")
    cloud = SfndLidar(path=str(tmp_path)).load("data_2_0000000153").cloud
    assert cloud is not None
    assert len(cloud) == 2000


def test_other_files_are_no_turns_of_the_course(tmp_path: Path) -> None:
    put(tmp_path / "data_1" / "0000000000.pcd", pcd(np.ones((3, 4)), points=9))
    with pytest.raises(InputError, match=r"0000000000\.pcd: .* 3 points, but its header says 9"):
        SfndLidar(path=str(tmp_path)).load("data_1_0000000000")
    with pytest.raises(InputError, match=r"no turns \(\.pcd\) .*puckbench data sfnd_lidar_1"):
        SfndLidar(path=str(tmp_path / "data_1")).names()


def poses() -> Floats:
    """Three poses of a bend to the left."""
    result = np.tile(np.eye(4), (3, 1, 1))
    turned = Rotation.from_euler("z", np.arange(3)[:, None] * 4.0, degrees=True)
    result[:, :3, :3] = turned.as_matrix()
    result[:, :3, 3] = [[0, 0, 0], [0.7, 0.1, 0], [1.4, 0.3, 0.02]]
    return result


@pytest.fixture
def lpcm(tmp_path: Path) -> Path:
    """Three turns with a tree at (9, 4, 1) of the first, and matrices as the authors have them."""
    tree = np.array([9.0, 4, 1, 1])
    before = np.eye(4)
    for number, pose in enumerate(poses(), 1):
        sees = np.linalg.inv(pose) @ tree
        row = np.array([[*sees[:3], 0.5], [5, 5, 5, 0.5]], "<f4")
        put(tmp_path / "test" / f"{number:06d}.bin", row.tobytes())
        matrix = np.linalg.inv(pose) @ before
        put(tmp_path / "test_matrix" / f"{number:06d}.bin", matrix.astype("<f4").tobytes())
        before = pose
    return tmp_path


def test_matrices_from_turn_to_turn_give_poses(lpcm: Path) -> None:
    scenes = InterLpcm(path=str(lpcm), registered=True)
    names = scenes.names()
    assert names == ["test_000001", "test_000002", "test_000003"]
    for name, pose in zip(names, poses(), strict=True):
        scene = scenes.load(name)
        assert scene.pose is not None
        assert scene.cloud is not None
        np.testing.assert_allclose(scene.pose, pose, atol=1e-6)
        seen = scene.pose @ [*scene.cloud.xyz[0], 1]
        np.testing.assert_allclose(seen, [9, 4, 1, 1], atol=1e-5)
    files = [f"{path.parent.name}/{path.name}" for path in scenes.files(names[2])]
    assert files == ["test/000003.bin", "test_matrix/000002.bin", "test_matrix/000003.bin"]
    thinned = InterLpcm(path=str(lpcm), registered=True, every=2)
    assert thinned.names() == names[::2]
    pose = thinned.load(names[2]).pose
    assert pose is not None
    np.testing.assert_allclose(pose, poses()[2], atol=1e-6)


def test_turns_have_no_poses_unless_they_are_asked_for(lpcm: Path) -> None:
    scenes = InterLpcm(path=str(lpcm))
    assert scenes.load("test_000002").pose is None
    assert [path.name for path in scenes.files("test_000002")] == ["000002.bin"]
    assert [count.line() for count in scenes.counts()] == ["3 of 20 published, which differs"]


def test_poses_of_returns_have_the_axes_of_returns(tmp_path: Path) -> None:
    pose = poses()[1]
    for number in (1, 2):
        put(tmp_path / "test" / f"{number:06d}.bin", as_kitti(hdl64(60)))
        matrix = np.linalg.inv(pose).astype("<f4")
        put(tmp_path / "test_matrix" / f"{number:06d}.bin", matrix.tobytes())
    own = InterLpcm(path=str(tmp_path), returns=True, registered=True).load("test_000002")
    points = InterLpcm(path=str(tmp_path), registered=True).load("test_000002")
    assert own.returns is not None
    assert own.pose is not None
    assert points.cloud is not None
    assert points.pose is not None
    there = own.returns.points() @ own.pose[:3, :3].T + own.pose[:3, 3]
    same = points.cloud.xyz @ points.pose[:3, :3].T + points.pose[:3, 3]
    np.testing.assert_allclose(there.min(axis=0), same.min(axis=0), atol=0.01)
    np.testing.assert_allclose(there.max(axis=0), same.max(axis=0), atol=0.01)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        np.eye(4, dtype="<f8").tobytes(),
        (2 * np.eye(4)).astype("<f4").tobytes(),
        np.full((4, 4), np.nan, "<f4").tobytes(),
        np.diag([1, 1, -1, 1]).astype("<f4").tobytes(),
    ],
)
def test_what_is_no_matrix_of_a_motion_is_refused(lpcm: Path, content: bytes) -> None:
    (lpcm / "test_matrix" / "000002.bin").write_bytes(content)
    scenes = InterLpcm(path=str(lpcm), registered=True)
    with pytest.raises(InputError, match=r"000002\.bin: not a matrix of a motion"):
        scenes.load("test_000003")


def test_parts_of_the_turns_are_named(lpcm: Path) -> None:
    with pytest.raises(InputError, match="parts: unknown name '00'"):
        InterLpcm(path=str(lpcm), parts=("00",)).names()
    with pytest.raises(InputError, match=r"no turns \(\.bin\) .*puckbench data inter_lpcm_turns"):
        InterLpcm(path=str(lpcm / "test")).names()
