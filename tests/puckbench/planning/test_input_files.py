"""A file of the user that is replaced, whatever its time, changes the jobs that read it alone."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pcc_networks.catalogue import shipped
from puckbench.planning.workflow import Workflow
from puckbench.steps.step import PlannedStep
from tests.support.files import put

MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
CLOUD = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
FILES: dict[str, str | bytes] = {
    "clouds/turn_1.xyz": CLOUD,
    "clouds/turn_2.xyz": CLOUD,
    "meshes/chair.obj": MESH,
    "kitti/sequences/00/velodyne/000000.bin": bytes(32),
    "kitti/sequences/00/velodyne/000001.bin": bytes(32),
    "kitti/sequences/00/times.txt": "0\n0.1\n",
    "capod/CAPOD.cla": "PSB 1\n1 1\n\nHuman 0 1\n1\n",
    "capod/class1/m1.obj": MESH,
    "poses.txt": "1 0 0 0 0 1 0 0 0 0 1 0\n" * 2,
    "wall.pcap": "packets",
    "wall.xml": "a unit's calibration",
}


def scene_set(loader: str, path: str) -> dict[str, Any]:
    return {"loader": loader, "options": {"path": path}}


CONFIG: dict[str, Any] = {
    "scene_sets": {
        "turns": scene_set("point_clouds", "clouds"),
        "chairs": scene_set("mesh_files", "meshes"),
        "kitti": scene_set("kitti", "kitti"),
        "capod": scene_set("capod", "capod"),
    },
    "datasets": {
        "turns": {"scene_set": "turns", "make": "cloud"},
        "chairs": {"scene_set": "chairs", "make": "sample"},
        "kitti": {"scene_set": "kitti", "make": "cloud"},
        "capod": {"scene_set": "capod", "make": "sample"},
    },
    "drives": {
        "way": {
            "scene_set": "turns",
            "make": "cloud",
            "poses": "poses.txt",
            "tasks": {"registration": {}},
        }
    },
    "sensor_study": {"captures": {"wall": {"path": "wall.pcap"}}},
    "codecs": {"draco": {}, "pcgcv2_plus": {}},
    "train": {
        "mine": {"codec": "pcgcv2_plus", "datasets": ["chairs"], "start": "start.safetensors"}
    },
}


def jobs() -> Iterator[tuple[str, PlannedStep]]:
    """Plan every job that reads files of the user, as a new process does."""
    workflow = Workflow(CONFIG)
    for scenes in workflow.plan.scene_sets.values():
        for name in scenes.chosen:
            yield f"scene {name}", workflow.step("scene", scene_set=scenes.name, scene=name)
    yield "drive", workflow.step("drive_of_clouds", drives="way", drive="turn")
    yield "capture", workflow.step("capture_residuals", capture="wall")
    yield "training", workflow.step("weights", trained="mine")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, content in FILES.items():
        put(tmp_path / name, content)
    put(tmp_path / "start.safetensors", shipped()["pcgcv2_objects"].read_bytes())
    return tmp_path


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("clouds/turn_2.xyz", {"scene turn_2", "drive"}),
        ("meshes/chair.obj", {"scene chair"}),
        ("kitti/sequences/00/velodyne/000001.bin", {"scene 00_000001"}),
        ("kitti/sequences/00/times.txt", {"scene 00_000000", "scene 00_000001"}),
        ("capod/CAPOD.cla", {"scene m001"}),
        ("poses.txt", {"drive"}),
        ("wall.pcap", {"capture"}),
        ("wall.xml", {"capture"}),
        ("start.safetensors", {"training"}),
    ],
)
def test_a_replaced_file_changes_the_jobs_that_read_it(
    folder: Path, file: str, changed: set[str]
) -> None:
    before, path = dict(jobs()), folder / file
    new, stat = folder / "new", path.stat()
    content = path.read_bytes()
    new.write_bytes(content[:-1] + b" ")
    os.utime(new, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    new.replace(path)
    assert {name for name, job in jobs() if job.key != before[name].key} == changed
    put(path, content)  # back again, at another time
    assert dict(jobs()) == before
