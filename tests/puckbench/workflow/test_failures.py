"""Faults of a user's codec beside Draco: a line for each, and Draco's tables and report.

Jobs are forks of a server; other jobs are in tests/puckbench/steps/test_child.py.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cloud_files.clouds import read_cloud
from pointkit.files import remove_leftovers
from puckbench.codecs.coding import encoded
from puckbench.codecs.registry import open_codec
from puckbench.results.curves import read_curve
from tests.support.bench import ROOT
from tests.support.running import processes_in

CODECS = """
import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
from puckbench.codecs.base import Codec, PointCloud


class Good(Codec):
    rates = {"r1": {"step": 16}, "r2": {"step": 4}}

    def encode(self, cloud, rate):
        step = np.float64(self.rates[rate]["step"])
        return step.tobytes() + np.round(cloud.xyz / step).astype("<i4").tobytes()

    def decode(self, stream):
        return PointCloud(self.points(stream))

    def points(self, stream):
        return np.frombuffer(stream[8:], "<i4").reshape(-1, 3) * np.frombuffer(stream[:8])


class Raises(Good):
    def encode(self, cloud, rate):
        return [b"a"][1 if rate == "r2" else 0] + super().encode(cloud, rate)

    def points(self, stream):
        return super().points(stream[1:])


class Nothing(Good):
    def encode(self, cloud, rate):
        return None


class Flat(Good):
    def points(self, stream):
        return super().points(stream).ravel()


class OnItsSide(Good):
    def points(self, stream):
        return super().points(stream).T


class NotFinite(Good):
    def points(self, stream):
        return super().points(stream) * np.inf


class Hungry(Good):
    def encode(self, cloud, rate):
        return np.zeros(10**16).tobytes()


class Crashes(Good):
    def encode(self, cloud, rate):
        return ctypes.string_at(0)


class Exits(Good):
    def encode(self, cloud, rate):
        sys.exit(0)


class Leaves(Good):
    def decode(self, stream):
        os._exit(3)


class LeavesWell(Good):
    def encode(self, cloud, rate):
        os._exit(0)


class Killed(Good):
    def encode(self, cloud, rate):
        os.kill(os.getpid(), signal.SIGKILL)


class Mute(Good):
    def encode(self, cloud, rate):
        sys.stdout.close()
        return super().encode(cloud, rate)


class Deaf(Good):
    def encode(self, cloud, rate):
        os.closerange(1, 3)
        return super().encode(cloud, rate)


class Moves(Good):
    def encode(self, cloud, rate):
        os.chdir("/")
        return super().encode(cloud, rate)

    def decode(self, stream):
        os.chdir("/")
        return super().decode(stream)


class Starts(Good):
    def encode(self, cloud, rate):
        start_processes()
        return super().encode(cloud, rate)

    def decode(self, stream):
        start_processes()
        return super().decode(stream)


class StartsAndDies(Good):
    def encode(self, cloud, rate):
        start_processes()
        os._exit(7)


def start_processes():
    # The last process has no parent.
    threading.Thread(target=time.sleep, args=(600,)).start()
    multiprocessing.get_context("fork").Process(target=time.sleep, args=(600,)).start()
    subprocess.Popen(["sleep", "600"])
    chatter = "while true; do echo here; sleep 0.01; done"
    subprocess.run(["sh", "-c", f"setsid sh -c '{chatter}' &"])


class Hangs(Good):
    def encode(self, cloud, rate):
        while True:
            time.sleep(0.01)


class Random(Good):
    def encode(self, cloud, rate):
        return super().encode(cloud, rate) + np.random.default_rng().bytes(12)

    def points(self, stream):
        return super().points(stream[:-12])


class Wavers(Good):
    def points(self, stream):
        return super().points(stream) + np.random.default_rng().random()


class Loses(Good):
    def points(self, stream):
        return super().points(stream)[:10]
"""
FAULTS = {
    "raises": "rate r2: IndexError: list index out of range (faulty.py:31)",
    "nothing": "rate r1: encode returned NoneType, not bytes",
    "flat": "rate r1: expected points of shape (n, 3), got (9000,)",
    "on_its_side": "expected points of shape (n, 3), got (3, 3000)",
    "not_finite": "rate r1: 3000 of 3000 points are not finite",
    "hungry": "MemoryError",
    "crashes": "the process died: Segmentation fault; killed by signal 11 (SIGSEGV)",
    "killed": "the process was killed by signal 9 (SIGKILL; out of memory?)",
    "mute": "cannot write to standard output, which a plug-in may have closed: ",
    "deaf": "the process ended itself with exit status 1",
    "starts_and_dies": "the process ended itself with exit status 7",
    "hangs": "took longer than its limit",
    "exits": "rate r1: SystemExit: exit status 0 (faulty.py:69)",
    "leaves": "the process ended itself with exit status 3",
    "leaves_well": "the process ended itself with exit status 0",
}
REMARKS = {
    "random": "repeated encodings differ",
    "wavers": "repeated decodings differ",
    "loses": "the decoded cloud is off by 15% of the diameter",
}


NAMES = (
    *("Raises", "Nothing", "Flat", "OnItsSide", "NotFinite", "Hungry", "Crashes", "Killed"),
    *("Mute", "Deaf", "Hangs", "Exits", "Leaves", "LeavesWell", "StartsAndDies"),
    *("Random", "Wavers", "Loses", "Moves", "Starts"),
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str, int]:
    folder = tmp_path_factory.mktemp("faults")
    (folder / "faulty.py").write_text(CODECS)
    xy = np.random.default_rng(0).random((3000, 2)) * 1000
    np.savetxt(folder / "c.xyz", np.column_stack([xy, 200 + 50 * np.sin(xy[:, 0] / 90)]))
    own = [f"faulty.py:{name}" for name in NAMES]
    words = ["run", "c.xyz", "--codecs", "draco", *own, "--rates", "r1", "r2", "--timeout", "30"]
    process = subprocess.run(
        [sys.executable, "-m", "puckbench", *words, "--cores", "2"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        check=False,
    )
    return folder, process.stdout, process.stderr, process.returncode


def test_a_failed_job_is_exit_status_1(finished: tuple[Path, str, str, int]) -> None:
    assert finished[3] == 1, finished[2]


@pytest.mark.parametrize("codec", FAULTS)
def test_a_fault_is_one_line_that_names_codec_cloud_and_log(
    codec: str, finished: tuple[Path, str, str, int]
) -> None:
    folder, output, errors, _ = finished
    lines = [
        line
        for line in errors.splitlines()
        if line.startswith(f"puckbench: failed: codec {codec},")
    ]
    (line,) = lines
    assert "cloud clouds/c" in line
    assert FAULTS[codec] in line
    log = folder / line.rpartition("log: ")[2].partition(" (and")[0]
    assert log.is_file()
    assert "CalledProcessError" not in errors
    assert f"left out: codec {codec}, cloud clouds/c: " in output


@pytest.mark.parametrize("codec", REMARKS)
def test_an_odd_result_is_told(codec: str, finished: tuple[Path, str, str, int]) -> None:
    _, output, _, _ = finished
    assert f"codec {codec}, cloud clouds/c, r1: {REMARKS[codec]}" in output


def test_no_process_and_no_incomplete_file_stays(finished: tuple[Path, str, str, int]) -> None:
    folder = finished[0]
    assert processes_in(folder) == []
    assert remove_leftovers(folder / "out") == 0


def test_the_streams_of_other_codecs_are_the_same(finished: tuple[Path, str, str, int]) -> None:
    out, draco = finished[0] / "out", open_codec("draco")
    cloud = read_cloud(out / "clouds/clouds/c.ply")
    curve = read_curve(out / "coded/clouds/c/draco.zip")
    assert {rate: coded.stream for rate, coded in curve.items()} == {
        rate: encoded(draco, cloud, rate) for rate in ("r1", "r2")
    }


def test_tables_and_report_have_what_succeeded(finished: tuple[Path, str, str, int]) -> None:
    folder, output, _, _ = finished
    table = pd.read_csv(folder / "out/tables/metrics.csv")
    assert set(table["codec"]) == {"draco", "random", "wavers", "loses", "moves", "starts"}
    left_out = pd.read_csv(folder / "out/tables/left_out.csv")
    curves = {f"codec {codec}, cloud clouds/c" for codec in FAULTS}
    assert set(left_out["file"]) == {"unit of clouds", *curves}
    page = (folder / "out/report.html").read_text()
    assert "list index out of range" in page
    assert "Draco" in output
