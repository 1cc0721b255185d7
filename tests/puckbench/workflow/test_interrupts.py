"""A run that is interrupted or killed: all its processes end, and the same command continues."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from puckbench.steps import fork_server
from tests.support.running import processes_in

WAITS = """
import os
import time
from pathlib import Path

import numpy as np
from puckbench.codecs.base import Codec, PointCloud


class Waits(Codec):
    rates = {"r1": {}}

    def encode(self, cloud, rate):
        number = Path(__file__).with_name("number")
        if not number.exists():
            number.with_suffix(".new").write_text(str(os.getpid()))
            number.with_suffix(".new").rename(number)
            time.sleep(600)
        return cloud.xyz.tobytes()

    def decode(self, stream):
        return PointCloud(np.frombuffer(stream).reshape(-1, 3))
"""
CONFIG = """
results: out
scene_sets: {clouds: {loader: point_clouds, options: {path: cloud.npy}}}
datasets: {clouds: {scene_set: clouds, make: cloud}}
codecs: {waits: {class: "waits.py:Waits"}}
"""
CURVE = "out/coded/clouds/cloud/waits.zip"
COMMAND = [sys.executable, "-m", "puckbench", "run", "--cores", "1", "small.yaml", "--", CURVE]


def _begun(folder: Path) -> subprocess.Popen[str]:
    """A run that codes a cloud, and waits."""
    np.save(folder / "cloud.npy", np.random.default_rng(0).random((50, 3)))
    (folder / "waits.py").write_text(WAITS)
    (folder / "small.yaml").write_text(CONFIG)
    process = subprocess.Popen(
        COMMAND,
        cwd=folder,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )
    while not (folder / "number").exists():
        time.sleep(0.05)
        assert process.poll() is None
    return process


@pytest.mark.parametrize(
    ("sent", "forked"),
    [("INT", True), ("TERM", True), ("HUP", True), ("TERM", False), ("KILL", False)],
)
def test_an_interrupted_run_leaves_no_process_and_continues(
    sent: str, forked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not forked:
        monkeypatch.setenv(fork_server.VARIABLE, "off")
    process = _begun(tmp_path)
    process.send_signal(getattr(signal, f"SIG{sent}"))
    said = process.communicate()[1]
    if sent == "KILL":
        while processes_in(tmp_path):
            time.sleep(0.05)
    else:
        assert process.returncode == 130
        assert said.endswith("\npuckbench: interrupted\n")
    assert not processes_in(tmp_path)
    subprocess.run(COMMAND, cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / CURVE).exists()


def test_the_server_of_a_killed_run_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(fork_server.VARIABLE)
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    process = _begun(tmp_path)
    assert any("fork_server" in words for words in processes_in(tmp_path))
    process.kill()
    process.communicate()
    while processes_in(tmp_path):
        time.sleep(0.05)
    assert not list((tmp_path / "temporary").glob("*"))
