"""Distance to the truth and recovery of primitives by hand, where both are known."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from virtual_lidar.scan_table import read_scan

FLOOR = "OFF\n4 1 0\n-100 -100 0\n100 -100 0\n100 100 0\n-100 100 0\n4 0 1 2 3\n"
TOO_FAR_M = 0.05


def _json(capsys: pytest.CaptureFixture[str], *words: object) -> Any:
    capsys.readouterr()
    assert main([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_floor_measured_too_far_is_as_deep_below_it_as_the_angles_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    floor, scan, cloud, truth = (
        tmp_path / name for name in ("floor.off", "scan.parquet", "cloud.ply", "truth.ply")
    )
    floor.write_text(FLOOR)
    sweep = json.dumps({"duration_s": 0.1, "azimuth_step_deg": 1.0})
    errors = {"bias_sigma_m": 0.0, "ray_sigma_m": 0.0, "ray_mean_m": TOO_FAR_M}
    words = ["--errors", "vlp16", "--error-options", json.dumps(errors), "--sweep", sweep]
    place = ["--origin", 0, 0, 1.3, "--anywhere"]
    _json(capsys, "scan", floor, scan, *words, *place)
    scale = _json(capsys, "prepare", scan, cloud, "--truth", truth)["scale"]
    row = _json(capsys, "evaluate", cloud, cloud, "--truth", floor, "--clean", truth)
    depth = TOO_FAR_M * np.cos(read_scan(scan)["incidence"])
    squared = float(np.mean((scale * depth) ** 2))
    assert row["truth_acd_ba_plane"] == pytest.approx(squared, rel=1e-6)
    assert row["truth_acd_ba_point"] == pytest.approx(squared, rel=1e-6)
    assert row["clean_acd_ba_plane"] == pytest.approx(squared, rel=1e-4)  # of a rounded truth
    assert row["truth_hausdorff_plane_m"] == pytest.approx(float(depth.max()), rel=1e-4)
    # Along the ray it is TOO_FAR_M to the clean point of the same ray, which is rarely the nearest.
    assert squared < row["clean_acd_ba_point"] <= (scale * TOO_FAR_M) ** 2
    assert row["cd_plane"] == 0


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a wall and a floor, their points prepared and coded as points and as planes."""
    folder = tmp_path_factory.mktemp("wall")
    scene, sample, cloud = (folder / name for name in ("scene.ply", "sample.ply", "cloud.ply"))
    for words in (
        ["scene", "calibration", "wall_floor_2m", scene],
        ["sample", scene, sample, "--points", 30_000],
        ["prepare", sample, cloud, "--truth", folder / "truth.ply"],
        ["encode", cloud, folder / "points.bin", "--codec", "draco", "--rate", "r4"],
        ["encode", cloud, folder / "planes.bin", "--codec", "primitives", "--rate", "r5"],
    ):
        assert main([str(word) for word in words]) == 0
    return folder


def test_a_wall_and_a_floor_are_found_where_they_are(
    wall: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = (wall / "planes.bin", wall / "truth.ply", wall / "scene.ply")
    row = _json(capsys, "recovery", *files, "--dataset", "d", "--row", wall / "row.json")
    assert row == json.loads((wall / "row.json").read_text())
    assert (row["dataset"], row["codec"], row["rate"]) == ("d", "primitives", "r5")
    assert row["bpp"] == 8 * row["bytes"] / 30_000
    both, planes = row["kinds"]
    assert (both["kind"], planes["kind"]) == ("all", "plane")
    assert planes["true"] == planes["matched"] == 2
    assert planes["recall"] == 1
    assert planes["label_accuracy"] > 0.95
    assert planes["angle_deg"] < 0.5
    assert planes["position_m"] < 0.005
    assert planes["residual_m"] < 0.01


@pytest.mark.parametrize(
    ("stream", "points", "scene", "fault"),
    [
        ("none.bin", "truth.ply", "scene.ply", "none.bin: no such file"),
        ("cut.bin", "truth.ply", "scene.ply", "cut.bin: codec primitives: "),
        (
            "points.bin",
            "truth.ply",
            "scene.ply",
            "points.bin: codec draco does not encode surfaces",
        ),
        ("planes.bin", "bare.ply", "scene.ply", "bare.ply: the points have no labels"),
        ("planes.bin", "strange.ply", "scene.ply", "strange.ply: a point has a label that"),
        ("planes.bin", "truth.ply", "bare.off", "bare.off: the mesh has no labels"),
    ],
)
def test_what_cannot_be_compared_is_named(
    wall: Path,
    stream: str,
    points: str,
    scene: str,
    fault: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (wall / "cut.bin").write_bytes((wall / "planes.bin").read_bytes()[:40])
    (wall / "bare.off").write_text(FLOOR)
    item = np.zeros((1, 3))
    write_cloud(wall / "bare.ply", PointCloud(item))
    write_cloud(wall / "strange.ply", PointCloud(item, labels=np.array([2], np.int32)))
    capsys.readouterr()
    assert main(["recovery", *(str(wall / name) for name in (stream, points, scene))]) == 2
    assert fault in capsys.readouterr().err
