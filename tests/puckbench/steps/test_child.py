"""Jobs in processes of their own, without a server: how they end, and what they leave."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud
from puckbench.results.curves import read_curve
from puckbench.steps import fork_server
from tests.support.running import processes_in

OWN = """
import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from puckbench.codecs.base import Codec


class Own(Codec):
    rates = {name: {} for name in ("leave", "crash", "kill", "mute", "deaf", "start", "wait")}

    def encode(self, cloud, rate):
        subprocess.Popen(["sleep", "600"])
        subprocess.run(["sh", "-c", "setsid sh -c 'while true; do echo here; sleep 0.01; done' &"])
        if rate == "leave":
            os._exit(7)
        if rate == "crash":
            ctypes.string_at(0)
        if rate == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if rate == "mute":
            os.closerange(1, 2)
        if rate == "deaf":
            os.closerange(1, 3)
        if rate == "wait":
            Path("begun").touch()
            time.sleep(600)
        return b"coded"

    def decode(self, stream):
        raise NotImplementedError
"""
ENDS = {
    "leave": (7, "exit status 7"),
    "crash": (128 + signal.SIGSEGV, "killed by signal 11 (SIGSEGV)"),
    "kill": (128 + signal.SIGKILL, "killed by signal 9 (SIGKILL)"),
    "mute": (2, "puckbench: cannot write to standard output, which a plug-in may have closed: "),
    "deaf": (1, "exit status 1"),
    "start": (0, '{"job": "encode"'),
}


def _begun(folder: Path, rate: str) -> subprocess.Popen[bytes]:
    """A job that codes a cloud at a rate, with its log, as the workflow starts it."""
    points = np.random.default_rng(0).random((10, 3)) * 1023
    write_cloud(folder / "cloud.ply", PointCloud(points, about={"size": 1024}))
    (folder / "own.py").write_text(OWN)
    entry = {"class": f"{folder}/own.py:Own", "rates": [rate]}
    words = ["encode", json.dumps({"codec": "own", "entry": entry}), "cloud=cloud.ply"]
    with (folder / "job.log").open("w") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "puckbench.steps", *words, "curve=out.zip"],
            cwd=folder,
            env={**os.environ, fork_server.VARIABLE: "off"},
            stdout=log,
            stderr=log,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
        )


def _last_line(folder: Path) -> str:
    return (folder / "job.log").read_text().splitlines()[-1]


@pytest.mark.parametrize("rate", ENDS)
def test_a_log_tells_how_its_job_ended_and_no_process_stays(rate: str, tmp_path: Path) -> None:
    status, line = ENDS[rate]
    assert _begun(tmp_path, rate).wait() == status
    assert _last_line(tmp_path).startswith(line)
    assert processes_in(tmp_path) == []
    if status == 0:
        assert read_curve(tmp_path / "out.zip")[rate].stream == b"coded"


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_job_ends_with_the_process_that_started_it(sent: signal.Signals, tmp_path: Path) -> None:
    process = _begun(tmp_path, "wait")
    while not (tmp_path / "begun").exists():
        time.sleep(0.05)
    process.send_signal(sent)
    status = process.wait()
    if sent == signal.SIGKILL:  # the job then ends what it has started
        while processes_in(tmp_path):
            time.sleep(0.05)
    else:
        assert status == 130
        assert _last_line(tmp_path) == "puckbench: interrupted"
    assert processes_in(tmp_path) == []
    assert not (tmp_path / "out.zip").exists()
