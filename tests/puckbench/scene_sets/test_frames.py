"""Sets of clouds: KITTI's binary frames and 8i's voxelised bodies."""

from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud, write_cloud
from pointkit.errors import InputError
from puckbench.scene_sets.kitti import Kitti
from puckbench.scene_sets.voxelised8i import Voxelised8i
from puckbench.steps.preparation import prepare
from tests.support.files import put

FRAME = np.array([[10, -2, 0.5, 0.3], [-4, 3, -1.7, 0]], dtype="<f4")


@pytest.mark.parametrize(
    ("folder", "part"),
    [
        ("training/velodyne", "training"),
        ("sequences/00/velodyne", "00"),
        ("dataset/sequences/00/velodyne", "00"),
        (
            "2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data",
            "2011_09_26_drive_0001_sync",
        ),
    ],
)
def test_frames_of_every_layout(tmp_path: Path, folder: str, part: str) -> None:
    put(tmp_path / folder / "000000.bin", FRAME.tobytes())
    put(tmp_path / folder / "000001.bin", FRAME.tobytes())
    put(tmp_path / folder / "._000001.bin", b"resource fork")
    frames = Kitti(path=str(tmp_path))
    assert frames.names() == [f"{part}_000000", f"{part}_000001"]
    scene = frames.load(f"{part}_000001")
    assert scene.cloud is not None
    assert scene.cloud.xyz.tolist() == FRAME[:, :3].astype(np.float64).tolist()
    assert (scene.group, scene.origin) == (part, (0, 0, 0))


def test_points_that_are_not_finite_are_dropped_and_counted(tmp_path: Path) -> None:
    damaged = np.vstack([FRAME, [[np.nan, 0, 0, 0]], [[0, np.inf, 0, 0]]]).astype("<f4")
    put(tmp_path / "training" / "velodyne" / "000000.bin", damaged.tobytes())
    scene = Kitti(path=str(tmp_path)).load("training_000000")
    assert scene.cloud is not None
    assert len(scene.cloud) == 2
    assert scene.about["dropped_points"] == 2


def _frame(columns: int) -> bytes:
    """Sixty points, of which the last twenty are firings without a return."""
    random = np.random.default_rng(2)
    rows = np.column_stack([random.uniform(-40, 40, (60, 3)), np.full(60, 0.5), np.arange(60) % 32])
    rows[40:, :3] = 0
    return rows[:, :columns].astype("<f4").tobytes()


def test_missing_returns_of_a_frame_are_left_out_and_counted(tmp_path: Path) -> None:
    put(tmp_path / "training" / "velodyne" / "000000.bin", _frame(4))
    scene = Kitti(path=str(tmp_path)).load("training_000000")
    assert scene.cloud is not None
    assert len(scene.cloud) == 40
    assert (scene.about["missing_returns"], scene.about["dropped_points"]) == (20, 20)
    kept = Kitti(path=str(tmp_path), keep_missing=True).load("training_000000")
    assert kept.cloud is not None
    assert len(kept.cloud) == 60
    assert kept.about["dropped_points"] == 0


def test_frames_of_five_values_are_not_those_of_kitti(tmp_path: Path) -> None:
    put(tmp_path / "training" / "velodyne" / "000000.bin", _frame(5))
    with pytest.raises(InputError, match=r"000000\.bin: its points have 5 values each, not 4"):
        Kitti(path=str(tmp_path)).load("training_000000")


@pytest.mark.parametrize(("data", "message"), [(FRAME.tobytes()[:-3], "truncated"), (b"", "empty")])
def test_a_damaged_frame_is_named(tmp_path: Path, data: bytes, message: str) -> None:
    put(tmp_path / "training" / "velodyne" / "000000.bin", data)
    with pytest.raises(InputError, match=rf"000000\.bin: .*{message}"):
        Kitti(path=str(tmp_path)).load("training_000000")


def test_the_whole_object_benchmark_is_listed_without_reading_a_frame(tmp_path: Path) -> None:
    folder = tmp_path / "training" / "velodyne"
    folder.mkdir(parents=True)
    for number in range(7481):
        (folder / f"{number:06d}.bin").symlink_to("nowhere")
    frames = Kitti(path=str(tmp_path))
    assert len(frames.names()) == 7481
    assert [count.line() for count in frames.counts()] == ["7481 of 7481 published"]
    thinned = Kitti(path=str(tmp_path), every=1000)
    assert thinned.names()[:2] == ["training_000000", "training_001000"]
    assert thinned.counts() == frames.counts()


def test_parts_are_chosen_by_name(tmp_path: Path) -> None:
    for part in ("training", "testing"):
        put(tmp_path / part / "velodyne" / "000000.bin", FRAME.tobytes())
    assert Kitti(path=str(tmp_path), parts=("testing",)).names() == ["testing_000000"]
    with pytest.raises(InputError, match="unknown name '00'"):
        Kitti(path=str(tmp_path), parts=("00",)).names()


HEADER = (
    "ply\nformat ascii 1.0\ncomment Version 2, Copyright 2017, 8i Labs, Inc.\n"
    "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
)
VOXELS = ["10 1023 7 255 0 128", "0 0 0 1 2 3", "10 1023 7 9 9 9"]


def body(root: Path, name: str, lines: list[str]) -> None:
    text = HEADER.format(len(lines)) + "\n".join(lines) + "\n"
    put(root / name.partition("_")[0] / "Ply" / f"{name}.ply", text.encode())


def test_a_voxelised_body_keeps_its_colours_and_grid(tmp_path: Path) -> None:
    body(tmp_path, "loot_vox10_1000", VOXELS)
    scene = Voxelised8i(path=str(tmp_path)).load("loot_vox10_1000")
    cloud = scene.cloud
    assert cloud is not None
    assert cloud.colours is not None
    assert cloud.colours.tolist() == [[255, 0, 128], [1, 2, 3]]
    voxels = cloud.xyz / scene.about["metres_per_voxel"]
    np.testing.assert_allclose(voxels, [[10, -7, 1023], [0, 0, 0]], atol=1e-9)
    assert scene.about["metres_per_voxel"] == pytest.approx(1.8 / 1024)
    assert scene.about["double_voxels"] == 1
    assert scene.group == "loot"


def test_a_voxelised_body_is_prepared_on_its_own_grid(tmp_path: Path) -> None:
    voxels = np.random.default_rng(0).integers(0, 1024, (40, 3))
    body(tmp_path, "loot_vox10_1000", [f"{x} {y} {z} 1 2 3" for x, y, z in voxels])
    cloud = Voxelised8i(path=str(tmp_path)).load("loot_vox10_1000").cloud
    assert cloud is not None
    ready = prepare(cloud, "grid", 5)
    # Turned by a quarter about x, so that y is up: z runs downwards along y, from the far side.
    x, y, z = voxels.T
    assert ready.xyz.tolist() == np.stack([x, 1023 - z, y], axis=1).tolist()


def test_a_voxel_has_the_size_of_the_header_unless_another_is_given(tmp_path: Path) -> None:
    comment = "comment frame_to_world_scale 0.181985\ncomment width 1023\nelement"
    text = HEADER.replace("element", comment, 1).format(3) + "\n".join(VOXELS) + "\n"
    put(tmp_path / "loot_vox10_1000.ply", text.encode())
    own = Voxelised8i(path=str(tmp_path)).load("loot_vox10_1000")
    values = Voxelised8i(path=str(tmp_path), height_m=1.024).load("loot_vox10_1000")
    assert own.about["metres_per_voxel"] == pytest.approx(0.00181985)
    assert values.about["metres_per_voxel"] == pytest.approx(0.001)


def test_the_colours_survive_a_file_of_ours(tmp_path: Path) -> None:
    body(tmp_path / "in", "loot_vox10_1000", VOXELS)
    cloud = Voxelised8i(path=str(tmp_path / "in")).load("loot_vox10_1000").cloud
    assert cloud is not None
    write_cloud(tmp_path / "out.ply", cloud)
    again = read_cloud(tmp_path / "out.ply")
    assert again.colours is not None
    assert again.colours.tolist() == [[255, 0, 128], [1, 2, 3]]
    assert again.xyz.tolist() == cloud.xyz.tolist()


def test_sequences_and_frames_are_chosen(tmp_path: Path) -> None:
    names = [f"{name}_vox10_{frame}" for name in ("loot", "soldier") for frame in (1000, 1001)]
    for name in names:
        body(tmp_path, name, VOXELS)
    body(tmp_path, "loot_vox10_1000_n", VOXELS)  # MPEG's, with normals: not a frame of the set
    assert Voxelised8i(path=str(tmp_path)).names() == names
    chosen = Voxelised8i(path=str(tmp_path), sequences=("soldier",), every=2)
    assert chosen.names() == ["soldier_vox10_1000"]
    held = {count.what: (count.held, count.published) for count in chosen.counts()}
    assert held["soldier"] == (2, 300)
    assert held["longdress"] == (0, 300)


@pytest.mark.parametrize("line", ["0.5 0 0 1 1 1", "1024 0 0 1 1 1", "0 -1 0 1 1 1"])
def test_a_point_off_the_grid_is_an_error(tmp_path: Path, line: str) -> None:
    body(tmp_path, "loot_vox10_1000", [*VOXELS, line])
    with pytest.raises(InputError, match="1 of 4 points are not on the grid of 10 bits"):
        Voxelised8i(path=str(tmp_path)).load("loot_vox10_1000")
