"""What the pages on scene sets and error models show runs, written from the pages alone."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from cloud_files.clouds import read_cloud
from cloud_files.meshes import read_mesh
from pointkit.lidar.sensors import load_sensor
from pointkit.registry import trust
from puckbench.cli import main
from puckbench.scene_sets.base import FolderSet, GeneratedSet, MeshFolderSet, SceneSet
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.user_files import FileSet
from tests.support.bench import Bench
from tests.support.pages import blocks, commands, page, write_files
from virtual_lidar import ErrorModel, ScanJob, open_error_model, open_sweep
from virtual_lidar.scenes.rooms import make_room, room_origin

SCENES, ERRORS = "docs/how-to/bring_scenes.md", "docs/how-to/bring_an_error_model.md"
RUN = {"figures": {}, "sensor_study": False, "timing": {"repeats": 1}}
ROOMS = {"office/r101": (6, 4, 3), "lab/r7": (5, 5, 2.5)}


@pytest.fixture
def folder(fresh: Bench, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with the pages' files and sizes of two rooms."""
    write_files(fresh.folder, SCENES, ERRORS)
    for name, size in ROOMS.items():
        path = fresh.folder / "data" / "rooms" / f"{name}.txt"
        path.parent.mkdir(parents=True)
        path.write_text(" ".join(map(str, size)))
    monkeypatch.chdir(fresh.folder)
    return fresh.folder


def members(*classes: type) -> Iterator[str]:
    """The public members that classes define, and what must be defined."""
    for kind in classes:
        yield from vars(kind)
        yield from kind.__annotations__


@pytest.mark.parametrize(
    ("name", "classes"),
    [
        (SCENES, (SceneSet, GeneratedSet, FolderSet, MeshFolderSet, FileSet)),
        (ERRORS, (ErrorModel,)),
    ],
)
def test_every_member_is_on_its_page(name: str, classes: tuple[type, ...]) -> None:
    public = {member for member in members(*classes) if not member.startswith(("_", "model_"))}
    named = set(re.findall(r"`(\w+)(?:\([^`]*\))?`", page(name)))
    assert public - named == set()


def test_rooms_of_text_files_run_and_are_made_again_if_a_file_changes(
    fresh: Bench, folder: Path
) -> None:
    config = yaml.safe_load(blocks(SCENES, "yaml")[0])
    (folder / "config.yaml").write_text(yaml.safe_dump({**config, **RUN}))
    fresh.made("tables")
    table = pd.read_csv(fresh.results / "tables" / "metrics.csv")
    assert set(table.cloud) == {"r101", "r7"}
    assert table[table.dataset == "sampled"].points_in.tolist() == [5000, 5000]
    for name, (width, depth, height) in ROOMS.items():
        kind, stem = name.split("/")
        mesh = read_mesh(fresh.results / "scenes" / "rooms" / f"{stem}.ply")
        area = 2 * (width * depth + depth * height + height * width)
        assert mesh.areas().sum() == pytest.approx(area)
        cloud = read_cloud(fresh.results / "clouds" / "sampled" / f"{stem}.ply")
        assert (cloud.about["group"], cloud.about["name"]) == (kind, stem)
        assert cloud.labels is not None
        metres = cloud.to_metres(cloud.xyz)
        off = np.abs(np.abs(metres) - np.array([width, depth, height]) / 2).min(axis=1)
        assert off.max() < 1e-3
    assert fresh.planned("tables") == {}
    (folder / "data" / "rooms" / "lab" / "r7.txt").write_text("5 4 2.5")
    assert fresh.planned("tables")["scene"] == 1


def test_the_commands_show_a_scene(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in commands(SCENES):
        assert main(words[1:]) == 0
    assert len(read_mesh(folder / "room.ply").triangles) == 12
    for name, text in (("empty", None), ("broken", "6 4")):
        (bad := folder / name / "x").mkdir(parents=True)
        if text:
            (bad / "r.txt").write_text(text)
        words = ["scene", "example_rooms.py:Rooms", "r", "r.ply", "--options"]
        assert main([*words, f'{{"path": "{name}"}}']) == 2
    errors = capsys.readouterr().err
    expected = "expected rooms, with office/r101.txt, ..."
    assert f"empty: no rooms (<kind>/<room>.txt) ({expected})" in errors
    assert "broken/x/r.txt: not three numbers" in errors


def test_clouds_and_turns_run(fresh: Bench, folder: Path) -> None:
    rng = np.random.default_rng(1)
    (folder / "clouds").mkdir()
    (folder / "turns").mkdir()
    columns = np.column_stack([rng.normal(0, 2000, (500, 3)), rng.integers(0, 256, 500)])
    np.save(folder / "clouds" / "a.npy", columns)
    ranges = rng.integers(500, 5000, (1800, 16)) * (rng.random((1800, 16)) < 0.9)
    np.save(folder / "turns" / "a.npy", ranges)
    config = {
        "scene_sets": {
            kind: {"loader": f"example_clouds.py:{kind.title()}", "options": {"path": kind}}
            for kind in ("clouds", "turns")
        },
        "datasets": {
            kind: {"scene_set": kind, "make": "cloud", "size": "metric"}
            for kind in ("clouds", "turns")
        },
        "codecs": {
            "gpcc": {"rates": ["100mm"], "options": {"attributes": True}},
            "puck": {"rates": ["20mm"]},
        },
        **RUN,
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    fresh.made("tables")
    table = pd.read_csv(fresh.results / "tables" / "metrics.csv").set_index(["dataset", "codec"])
    assert table.points_in["clouds", "gpcc"] == 500
    assert table.points_in["turns", "puck"] == np.count_nonzero(ranges)
    cloud = read_cloud(fresh.results / "clouds" / "clouds" / "a.ply")
    assert np.ptp(cloud.xyz, axis=0) == pytest.approx(np.ptp(columns[:, :3], axis=0) / 1000)
    trust([place := "example_clouds.py:Turns"])
    scene = open_scene_set(place, {"path": "turns"}).load("a")
    assert scene.returns is not None
    points, sensor = scene.returns.points(), load_sensor("vlp16")
    lasers = np.nonzero(ranges)[1]
    heights = np.array(sensor.vertical_correction_mm)[lasers] / 1000
    away = np.linalg.norm(points - np.outer(heights, [0, 0, 1]), axis=1)
    assert away == pytest.approx(0.002 * ranges[ranges > 0])


def _scan(**options: Any) -> pd.DataFrame:
    """The table of a scan by the page's second command, with other options."""
    first, second = (words[1:] for words in commands(ERRORS))
    if not Path("room.ply").exists():
        assert main(first) == 0
    second[second.index("--error-options") + 1] = str(options).replace("'", '"')
    sweep = '{"duration_s": 0.2, "azimuth_step_deg": 0.8}'
    assert main([*second, "--sweep", sweep]) == 0
    return pd.read_parquet("scan.parquet")


def test_the_error_model_has_the_statistics_that_it_states(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    none = {"laser_sigma_m": 0, "frame_sigma_m": 0}
    every, kept = _scan(**none, lost=0), _scan(**none, lost=0.2)
    scaled = (every.distance_noisy - every.distance - 0.02) * np.cos(every.incidence)
    steep = every.incidence < np.arccos(0.1)  # where the noise is not limited
    count = steep.sum()
    assert count > 5_000
    assert abs(scaled[steep].mean()) < 5 * 0.004 / np.sqrt(count)
    assert scaled[steep].std() == pytest.approx(0.004, rel=5 / np.sqrt(2 * count))
    share = 1 - len(kept) / len(every)
    assert abs(share - 0.2) < 5 * np.sqrt(0.2 * 0.8 / len(every))
    # a ray that is kept has the same noise
    key = ["frame", "yaw", "laser_id"]
    both = every.merge(kept, on=key, suffixes=("", "_kept"))
    assert len(both) == len(kept)
    assert both.distance_noisy.equals(both.distance_noisy_kept)
    _scan(lost=0)
    capsys.readouterr()
    (code,) = (block for block in blocks(ERRORS, "python") if "read_parquet" in block)
    exec(compile(code, ERRORS, "exec"), {})  # noqa: S102
    mean, lasers, rays = map(float, re.findall(r"-?\d\.\d{4}", capsys.readouterr().out))
    assert abs(mean - 0.02) < 4 * 0.01 / 4 + 4 * 0.005 / np.sqrt(24)
    assert 0.005 < lasers < 0.016  # of 16: 0.01 with a relative error of 18 %
    assert 0.004 < rays < 0.012


def test_the_error_model_does_not_depend_on_the_frames_of_a_call(folder: Path) -> None:
    trust([place := "example_warm_up.py:WarmUp"])
    copy_room = ("copy_room_1", 1)
    room, sensor = make_room(*copy_room), load_sensor("vlp16")
    sweep = open_sweep({"duration_s": 0.05, "azimuth_step_deg": 0.5})
    job = ScanJob(room, sensor, sweep, open_error_model(place), room_origin(*copy_room))
    tables = [job.table(np.random.default_rng(1), rays_at_a_time=rays) for rays in (1, 10**6)]
    assert len(tables[0]) == len(tables[1]) > 1000
    assert np.array_equal(tables[0]["distance_noisy"], tables[1]["distance_noisy"])


def test_a_run_scans_with_the_error_model(fresh: Bench, folder: Path) -> None:
    config = yaml.safe_load(blocks(ERRORS, "yaml")[0])
    rooms = {"loader": "embedded_rooms", "options": {"rooms": ["copy_room_1"], "detail": 0.3}}
    for entry in config["datasets"].values():
        entry |= {"sweep": {"duration_s": 0.02}}
    config |= {"scene_sets": {"rooms": rooms}, "codecs": {"gpcc": {"rates": ["r1"]}}}
    (folder / "config.yaml").write_text(yaml.safe_dump({**RUN, **config}))
    scans = [f"results/scans/{name}/copy_room_1.parquet" for name in config["datasets"]]
    fresh.made(*scans)
    spreads = []
    for scan in scans:
        table = pd.read_parquet(folder / scan)
        error = table.distance_noisy - table.distance
        spreads.append(error.groupby([table.frame, table.laser_id]).std().median())
    assert spreads[0] > 2 * spreads[1]  # 4 mm and 1 mm
