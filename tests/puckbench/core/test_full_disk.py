"""A disk that takes no more: one line that names the file, and nothing half written."""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cloud_files.clouds import write_cloud
from cloud_files.meshes import write_mesh
from pointkit.errors import InputError
from pointkit.files import write_json
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.sensors import load_sensor
from pointkit.tables import write_table
from puckbench.cli import main
from puckbench.figures.drawing import save_figure
from puckbench.recordings.export import FORMATS, export
from tests.support.sensor_scenes import ROOM, room
from virtual_lidar import ScanTable, open_error_model, open_sweep, scan, write_scan
from virtual_lidar.scan_table import write_scan_portions

SIZE = 1000
"""Bytes that a file may have: fewer than any of those written here needs."""
NUMBERS = np.random.default_rng(0).random((3000, 3))


@contextmanager
def _full_disk() -> Iterator[None]:
    """No file of this process grows beyond `SIZE`, as on a disk without room."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    heard = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (SIZE, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, heard)


def _scan() -> ScanTable:
    sweep = open_sweep({"duration_s": 0.05, "azimuth_step_deg": 1.0})
    model, rng = open_error_model("vlp16"), np.random.default_rng(0)
    return scan(room(), load_sensor("vlp16"), sweep, model, ROOM / 2, rng)


def _draw(path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure()
    figure.subplots().plot(NUMBERS[:, 0])
    save_figure(figure, path)


def _train(path: Path) -> None:
    from pcc_networks.training.settings import Pcgcv2Training

    with Pcgcv2Training(lmbdas=(1.0,), channels=(4, 8, 8, 8), steps=1).trainer() as trainer:
        trainer.save(path)


TABLE = pd.DataFrame(NUMBERS, columns=list("abc"))
WRITERS: dict[str, Callable[[Path], object]] = {
    "cloud.ply": lambda path: write_cloud(path, PointCloud(NUMBERS)),
    "mesh.ply": lambda path: write_mesh(path, room()),
    "scan.parquet": lambda path: write_scan(path, _scan()),
    "portions.parquet": lambda path: write_scan_portions(path, iter([_scan(), _scan()])),
    "residuals.parquet": lambda path: write_table(TABLE, path),
    "table.csv": lambda path: write_table(TABLE, path),
    "table.parquet": lambda path: write_table(TABLE, path),
    "row.json": lambda path: write_json(path, NUMBERS.tolist()),
    "figure.pdf": _draw,
    "figure.png": _draw,
    "checkpoint.pt": _train,
    **{f"scan{suffix}": lambda path: export(path, _scan()) for suffix in FORMATS},
}


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Loops are compiled, and cached on disk, while there is room."""
    _scan()


@pytest.mark.parametrize("name", WRITERS)
def test_a_writer_names_the_file_and_leaves_what_was_there(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"old")
    with pytest.raises(InputError, match=f"{name}: file too large"), _full_disk():
        WRITERS[name](path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_command_ends_in_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_cloud(tmp_path / "cloud.ply", PointCloud(NUMBERS * 1023))
    out = tmp_path / "out" / "cloud.drc"
    with _full_disk():
        words = ["encode", tmp_path / "cloud.ply", out, "--codec", "draco", "--rate", "r8"]
        assert main([str(word) for word in words]) == 2
    assert capsys.readouterr().err == f"puckbench: {out}: file too large\n"
    assert list(out.parent.iterdir()) == []


def test_a_cloud_and_its_description_stay_a_pair(tmp_path: Path) -> None:
    write_cloud(tmp_path / "cloud.ply", PointCloud(NUMBERS[:5], about={"name": "old"}))
    before = (tmp_path / "cloud.ply").read_bytes()
    with pytest.raises(InputError), _full_disk():
        write_cloud(tmp_path / "cloud.ply", PointCloud(NUMBERS, about={"name": "new"}))
    assert (tmp_path / "cloud.ply").read_bytes() == before
    assert json.loads((tmp_path / "cloud.json").read_text()) == {
        "puckbench": "cloud",
        "name": "old",
        "points": 5,
    }


def test_output_that_nobody_can_take_is_one_line() -> None:
    command = [sys.executable, "-m", "puckbench", "codecs"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 2
    assert done.stderr == b"puckbench: standard output: no space left on device\n"
