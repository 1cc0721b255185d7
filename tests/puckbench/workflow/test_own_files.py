"""Programs, libraries, data and modules of a user's codec: a change plans exactly its curves."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.bench import ROOT, Bench

MINE = """
import ctypes
import json
import sys
from pathlib import Path

import numpy as np

from puckbench.codecs.base import PointCloud
from puckbench.codecs.external import ExternalCodec, folder

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "lib"))


class Mine(ExternalCodec):
    programs = ("./build/mycodec",)
    rates = {"r1": {}, "r2": {}}

    def encode(self, cloud, rate):
        from my_library.steps import FACTOR

        ctypes.CDLL(str(HERE / "libmine.so"))
        step = json.loads((HERE / "table.json").read_text())["step"]
        step *= np.load(HERE / "weights" / f"{rate}.npy")
        cells = np.round(cloud.xyz / (step * FACTOR)).astype("<i2")
        with folder() as at:
            (at / "in").write_bytes(cells.tobytes())
            self.run(("./build/mycodec", at / "in", at / "out"), at / "in")
            return (at / "out").read_bytes()

    def decode(self, stream):
        return PointCloud(np.frombuffer(stream, "<i2").reshape(-1, 3) * 1.0)
"""
PROGRAM = '#!/bin/sh\ntest -f ./build/libcore.so && cp "$1" "$2"\n'
CONFIG: dict[str, Any] = {
    "scene_sets": {"files": {"loader": "point_clouds", "options": {"path": "clouds"}}},
    "datasets": {"mine": {"scene_set": "files", "make": "cloud"}},
    "codecs": {
        "raw_grid": {"class": "raw_grid.py:Raw", "rates": {"r1": {"step": 1.0}}},
        "mine": {"class": "codecs/mine.py:Mine"},
    },
    "sensor_study": None,
    "figures": {},
}
ROWS = [f"results/metrics/mine/{c}/{codec}.parquet" for c in "ab" for codec in ("raw_grid", "mine")]
CURVES = {"encode_mine": 2, "evaluate_mine": 2}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A folder in which two clouds were coded and measured with two codecs of the user."""
    bench = Bench(tmp_path_factory.mktemp("original"))
    at = bench.folder
    for folder in ("clouds", "codecs/weights", "build", "lib/my_library"):
        (at / folder).mkdir(parents=True)
    for cloud in "ab":
        points = "".join(f"{k % 3} {k % 4} {ord(cloud) + k % 2}\n" for k in range(12))
        (at / "clouds" / f"{cloud}.xyz").write_text(points)
    (at / "codecs/mine.py").write_text(MINE)
    shutil.copy(np.random._common.__file__, at / "codecs/libmine.so")
    (at / "codecs/table.json").write_text(json.dumps({"step": 1.0}))
    for rate in (1, 2):
        np.save(at / f"codecs/weights/r{rate}.npy", np.float64(3 - rate))
    (at / "lib/my_library/__init__.py").write_text("")
    (at / "lib/my_library/steps.py").write_text("FACTOR = 1\n")
    (at / "build/mycodec").write_text(PROGRAM)
    (at / "build/mycodec").chmod(0o755)
    (at / "build/libcore.so").write_bytes(b"1")
    bench.configure(CONFIG)
    bench.made(*ROWS)
    return bench


@pytest.fixture
def copied(original: Bench, tmp_path: Path) -> Bench:
    """A copy of that folder, without Snakemake's memory."""
    return original.copied(tmp_path / "copy")


def _append(path: Path) -> None:
    with path.open("ab") as stream:
        stream.write(b"# changed\n")


def _replace(path: Path) -> None:
    """As a build does that keeps size and time."""
    content, times = path.read_bytes(), path.stat()
    path.unlink()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    path.chmod(times.st_mode)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


@pytest.mark.parametrize(
    ("file", "change"),
    [
        ("build/mycodec", _append),
        ("build/mycodec", _replace),
        ("build/libcore.so", _append),
        ("codecs/libmine.so", _append),
        ("codecs/table.json", _append),
        ("codecs/table.json", Path.unlink),
        ("codecs/weights/r2.npy", _append),
        ("lib/my_library/steps.py", lambda path: path.write_text("FACTOR = 2\n")),
        ("codecs/mine.py", lambda path: path.write_text(f'{MINE}    version = "2"\n')),
    ],
)
def test_a_change_plans_exactly_the_curves_of_the_codec(
    copied: Bench, file: str, change: Callable[[Path], object]
) -> None:
    change(copied.folder / file)
    assert copied.planned(*ROWS) == CURVES


def test_files_that_the_codec_does_not_use_plan_nothing(copied: Bench) -> None:
    at = copied.folder
    for name in ("notes.txt", "other.yaml", "codecs/plot.csv", "codecs/weights/r.txt"):
        (at / name).write_text("new")
    (at / "build/Makefile").write_text("new")
    (at / "build/libother.so").write_bytes(b"new")
    (at / "lib/my_library/unused.py").write_text("x = 1\n")
    (at / "lib/my_library/steps.py").write_text("# The factor.\nFACTOR = 1\n")
    for path in (at / "build/mycodec", at / "codecs/table.json"):
        path.touch()
    assert copied.planned(*ROWS) == {}


def test_a_missing_program_plans_nothing(copied: Bench) -> None:
    (copied.folder / "build/mycodec").unlink()
    assert copied.planned(*ROWS) == {}


def test_after_the_run_nothing_is_planned(copied: Bench) -> None:
    _append(copied.folder / "build/mycodec")
    _append(copied.folder / "codecs/libmine.so")
    copied.made(*ROWS)
    assert copied.planned(*ROWS) == {}
    (copied.folder / "codecs/table.json").write_text(json.dumps({"step": 0.5}))
    assert copied.planned(*ROWS) == CURVES  # with Snakemake's memory


def _run(bench: Bench, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "puckbench", "run", "--cores", "2", *words],
        cwd=bench.folder,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_codec_is_run_again_on_request(copied: Bench) -> None:
    files = [path for kind in ("coded", "metrics") for path in (copied.results / kind).rglob("*.*")]
    before = {path: path.stat().st_mtime_ns for path in files}
    done = _run(copied, "--again", "mine", "config.yaml", "--", *ROWS)
    assert done.returncode == 0, done.stderr[-4000:]
    again = {path for path in files if path.stat().st_mtime_ns != before[path]}
    assert again == {path for path in files if path.stem == "mine"}
    assert copied.planned(*ROWS) == {}


def test_the_curves_of_a_codec_are_planned_on_request(
    copied: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PUCKBENCH_AGAIN", "mine")
    assert copied.planned(*ROWS) == CURVES


def test_an_unknown_codec_is_one_line(copied: Bench) -> None:
    done = _run(copied, "--again", "mina", "config.yaml")
    assert done.returncode == 2
    line = "--again: no codec 'mina' (known: raw_grid, mine); did you mean 'mine'?"
    assert done.stderr.splitlines() == [f"puckbench: {line}"]
