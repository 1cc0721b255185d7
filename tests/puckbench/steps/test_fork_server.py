"""Jobs that a server forks: results, streams, status and end as those of a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import puckbench
from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud
from puckbench.results.curves import read_curve
from puckbench.steps import fork_server

OWN = """
import json, os, sys, time
from pathlib import Path

import numba
import numpy as np

from pointkit.geometry.morton import morton_codes
from puckbench.codecs.base import Codec

LOADED = len(morton_codes.signatures)
morton_codes(np.zeros((1, 3), np.int64), np.arange(3))


class Own(Codec):
    rates = {"r1": {}}

    def encode(self, cloud, rate):
        print("said", file=sys.stderr)
        if os.environ.get("WAIT") and not Path(os.environ["WAIT"]).exists():
            Path(os.environ["WAIT"]).write_text(str(os.getpid()))
            time.sleep(600)
        if os.environ.get("DIE"):
            os.kill(os.getpid(), 9)
        if os.environ.get("LEAVE"):
            os._exit(int(os.environ["LEAVE"]))
        found = {
            "forked": sys.argv[0] == "-c",
            "numpy in the parent": "_multiarray" in Path(f"/proc/{os.getppid()}/maps").read_text(),
            "threads": numba.get_num_threads(),
            "loaded": LOADED,
            "folder": os.getcwd(),
            "variable": os.environ.get("VARIABLE"),
        }
        return json.dumps(found).encode()

    def decode(self, stream):
        raise NotImplementedError
"""
KILLED = "puckbench: this job was killed, and runs again\n"
STARTER = """
import os, sys
from puckbench.steps.fork_server import VARIABLE, start_fork_server
start_fork_server(1, ["numpy", "pointkit.geometry.morton"])
print(os.environ[VARIABLE], flush=True)
sys.stdin.read()
"""

OTHER_USER = """
import os, socket, sys
role, name = sys.argv[1:]
os.setuid(65534)
with socket.socket(socket.AF_UNIX) as other:
    (other.connect if role == "client" else other.bind)(f"\\0{name}")
    if role == "client":
        try:
            socket.send_fds(other, [b"+"], [1, 2])
        except OSError:  # the server has ended the connection
            pass
    else:
        other.listen()
    print("another user", flush=True)
    if role == "server":
        other = other.accept()[0]
    try:
        received = other.recv(1)
    except ConnectionResetError:
        received = b""
    print("something" if received else "nothing received")
"""


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[str]]:
    """A process that has started a server, whose name is in the environment from now on."""
    monkeypatch.delenv(fork_server.VARIABLE, raising=False)
    starter = subprocess.Popen(
        [sys.executable, "-c", STARTER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=_hear_interrupts,  # noqa: PLW1509 (no other thread runs)
    )
    assert starter.stdout is not None
    with starter:
        monkeypatch.setenv(fork_server.VARIABLE, starter.stdout.readline().strip())
        monkeypatch.setenv("OMP_NUM_THREADS", "1")
        while not fork_server.is_serving():
            time.sleep(0.05)
        yield starter
        starter.kill()


@pytest.fixture
def job(tmp_path: Path) -> list[str]:
    """The words of a job that codes a cloud with a codec of its user's file."""
    points = np.random.default_rng(0).random((10, 3)) * 1023
    write_cloud(tmp_path / "cloud.ply", PointCloud(points, about={"size": 1024}))
    (tmp_path / "own.py").write_text(OWN)
    settings = {"codec": "own", "entry": {"class": f"{tmp_path}/own.py:Own"}, "repeats": 2}
    files = [f"cloud={tmp_path}/cloud.ply", f"curve={tmp_path}/out.zip"]
    return [sys.executable, "-m", "puckbench.steps", "encode", json.dumps(settings), *files]


def _run(
    words: list[str], folder: Path, **environment: str
) -> tuple[subprocess.CompletedProcess[str], dict[str, Any]]:
    """A job's process as it ended, and what its codec found."""
    done = subprocess.run(
        words,
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    curve = folder / "out.zip"
    result: dict[str, Any] = json.loads(read_curve(curve)["r1"].stream) if curve.exists() else {}
    curve.unlink(missing_ok=True)
    return done, result


@pytest.mark.usefixtures("server")
def test_a_forked_job_has_all_of_the_process_that_asked_for_it(
    job: list[str], tmp_path: Path
) -> None:
    done, result = _run(job, tmp_path, VARIABLE="value")
    assert (done.returncode, done.stderr) == (0, "said\nsaid\n")
    assert json.loads(done.stdout)["job"] == "encode"
    assert result["forked"]
    assert result["folder"] == str(tmp_path)
    assert result["variable"] == "value"
    assert _run(job, tmp_path)[1]["variable"] is None


@pytest.mark.usefixtures("server")
def test_a_forked_job_finds_what_the_server_imported(job: list[str], tmp_path: Path) -> None:
    assert _run(job, tmp_path)[1]["numpy in the parent"]


@pytest.mark.usefixtures("server")
def test_a_forked_job_finds_compiled_functions_of_jobs_before(
    job: list[str], tmp_path: Path
) -> None:
    """The first job may compile; what the second reads from the cache, the server then reads."""
    found = [_run(job, tmp_path)[1] for _ in range(3)]
    assert all(each["forked"] for each in found)
    assert found[0]["loaded"] == 0
    assert found[2]["loaded"] == 1


def test_a_server_imports_all_packages_that_jobs_use() -> None:
    folder = Path(puckbench.__file__).parent
    packages = {f"puckbench.{path.parent.name}" for path in folder.glob("*/__init__.py")}
    others = {f"puckbench.{name}" for name in ("checks", "cli", "core", "geometry", "planning")}
    assert packages - others == {
        name
        for name in (*fork_server.MODULES, *fork_server.LEARNED)
        if name.startswith("puckbench.")
    }


@pytest.mark.usefixtures("server")
def test_a_job_with_other_threads_is_an_ordinary_process(job: list[str], tmp_path: Path) -> None:
    numbers = ["1", "2", "1"]
    result = [
        _run(job, tmp_path, OMP_NUM_THREADS=number, NUMBA_NUM_THREADS=number)[1]
        for number in numbers
    ]
    assert [each["threads"] for each in result] == [1, 2, 1]
    assert [each["forked"] for each in result] == [True, False, True]


@pytest.mark.usefixtures("server")
@pytest.mark.skipif(os.getuid() != 0, reason="only root becomes another user")
@pytest.mark.parametrize("role", ["client", "server"])
def test_another_user_can_neither_use_nor_replace_the_server(
    role: str, job: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if role == "server":
        monkeypatch.setenv(fork_server.VARIABLE, "one of another user")
    words = [sys.executable, "-c", OTHER_USER, role, fork_server.address()[1:]]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "another user\n"
        assert _run(job, tmp_path)[1]["forked"] is (role == "client")
        assert other.stdout.read() == "nothing received\n"


@pytest.mark.usefixtures("server")
def test_no_server_is_started_where_one_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    def place() -> str:
        words = [sys.executable, "-c", STARTER]
        return subprocess.run(words, input="", capture_output=True, text=True, check=True).stdout

    name = os.environ[fork_server.VARIABLE]
    assert place() == f"{name}\n"
    monkeypatch.setenv("PYTHONPATH", f"/elsewhere{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    assert place() != f"{name}\n"


def test_no_server_is_started_where_it_is_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(fork_server.VARIABLE, "off")
    done = subprocess.run(
        [sys.executable, "-c", STARTER], input="", capture_output=True, text=True, check=True
    )
    assert done.stdout == "off\n"


@pytest.mark.usefixtures("server")
def test_a_job_s_status_and_errors_come_to_who_asked(job: list[str], tmp_path: Path) -> None:
    (tmp_path / "cloud.ply").unlink()
    done, _ = _run(job, tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("puckbench: ")
    assert done.stderr.count("\n") == 1
    (tmp_path / "bad.json").write_text("{")
    done, _ = _run([*job[:4], f"@{tmp_path}/bad.json", *job[5:]], tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"puckbench: {tmp_path}/bad.json: not valid JSON")


@pytest.mark.usefixtures("server")
def test_a_job_that_dies_again_by_itself_has_ended(job: list[str], tmp_path: Path) -> None:
    done, _ = _run(job, tmp_path, DIE="1")
    assert done.returncode == 128 + signal.SIGKILL
    assert done.stderr == f"said\n{KILLED}said\nkilled by signal 9 (SIGKILL)\n"


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize(("left_with", "status"), [("3", 3), ("0", 1)])
def test_a_job_that_leaves_at_once_has_failed_and_does_not_run_again(
    left_with: str, status: int, job: list[str], tmp_path: Path
) -> None:
    done, _ = _run(job, tmp_path, LEAVE=left_with)
    assert (done.returncode, done.stderr) == (status, f"said\nexit status {left_with}\n")


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize(
    "killed", [["job"], ["watcher", "job"], ["server", "watcher", "job"]], ids=" ".join
)
def test_a_job_that_is_killed_runs_again_by_itself(
    killed: list[str], job: list[str], tmp_path: Path
) -> None:
    asking, number = _begun(job, tmp_path)
    watcher = _parent(number)
    numbers = {"job": number, "watcher": watcher, "server": _parent(watcher)}
    for name in killed:
        os.kill(numbers[name], signal.SIGKILL)
    said = asking.communicate()[1]
    assert (asking.returncode, said) == (0, f"said\n{KILLED}said\nsaid\n")
    stream = read_curve(tmp_path / "out.zip")["r1"].stream
    assert json.loads(stream)["forked"] is False
    assert not _lives(number)


@pytest.mark.usefixtures("server")
def test_a_job_outlives_its_server_and_the_next_is_an_ordinary_process(
    job: list[str], tmp_path: Path
) -> None:
    asking, number = _begun(job, tmp_path)
    os.kill(_parent(_parent(number)), signal.SIGKILL)
    result = _run(job, tmp_path)[1]
    assert result["forked"] is False
    assert _lives(number)
    asking.send_signal(signal.SIGINT)
    asking.communicate()
    assert asking.returncode == 130
    assert not _lives(number)


@pytest.mark.usefixtures("server")
def test_a_job_ends_with_the_process_that_asked_for_it(job: list[str], tmp_path: Path) -> None:
    asking, number = _begun(job, tmp_path)
    asking.kill()
    asking.communicate()  # until the job, which has the same streams, lets go of them
    while _lives(number):
        time.sleep(0.05)
    assert not (tmp_path / "out.zip").exists()


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_job_is_interrupted_with_the_process_that_asked_for_it(
    sent: signal.Signals, job: list[str], tmp_path: Path
) -> None:
    asking, number = _begun(job, tmp_path)
    asking.send_signal(sent)
    said = asking.communicate()[1]
    assert (asking.returncode, said) == (130, "said\npuckbench: interrupted\n")
    assert not _lives(number)


def test_without_its_server_a_job_is_a_process_of_its_own(
    server: subprocess.Popen[str], job: list[str], tmp_path: Path
) -> None:
    assert _run(job, tmp_path)[1]["forked"]
    server.kill()  # the server sees it by the end of its standard input
    while fork_server.is_serving():
        time.sleep(0.05)
    done, result = _run(job, tmp_path)
    assert (done.returncode, result["forked"]) == (0, False)


@pytest.mark.usefixtures("server")
def test_another_python_does_not_use_the_server(job: list[str], tmp_path: Path) -> None:
    sources = os.environ.get("PYTHONPATH", "")
    done, result = _run(job, tmp_path, PYTHONPATH=os.pathsep.join(["/elsewhere", sources]))
    assert (done.returncode, result["forked"]) == (0, False)


def _hear_interrupts() -> None:
    """As a process in the foreground does: a shell lets those in the background ignore them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _begun(job: list[str], folder: Path) -> tuple[subprocess.Popen[str], int]:
    """The process that asked for a job, and the job's number, when it is at work."""
    begun = folder / "begun"
    environment = {**os.environ, "WAIT": str(begun)}
    asking = subprocess.Popen(
        job,
        env=environment,
        cwd=folder,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=_hear_interrupts,  # noqa: PLW1509 (no other thread runs)
    )
    while not (begun.exists() and begun.read_text()):
        time.sleep(0.05)
    number = int(begun.read_text())
    assert _lives(number)
    return asking, number


def _parent(number: int) -> int:
    return int(Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[1])


def _lives(number: int) -> bool:
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"
