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

from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import write_cloud
from puckbench.jobs import fork_server

OWN = """
import json, os, sys, time
from pathlib import Path

import numba

from puckbench.codecs.base import Codec


class Own(Codec):
    rates = {"r1": {}}

    def _encode(self, points, parameters):
        print("said", file=sys.stderr)
        if os.environ.get("WAIT") and not Path(os.environ["WAIT"]).exists():
            Path(os.environ["WAIT"]).write_text(str(os.getpid()))
            time.sleep(600)
        if os.environ.get("DIE"):
            os.kill(os.getpid(), 9)
        parent = Path(f"/proc/{os.getppid()}")
        found = {
            "forked": sys.argv[0] == "-c",
            "numpy in the parent": "_multiarray" in (parent / "maps").read_text(),
            "template": int((parent / "stat").read_text().split(")")[1].split()[1]),
            "threads": numba.get_num_threads(),
            "folder": os.getcwd(),
            "variable": os.environ.get("VARIABLE"),
        }
        return json.dumps(found).encode()

    def _decode(self, stream):
        raise NotImplementedError
"""
KILLED = "puckbench: this job was killed, and runs again\n"
STARTER = """
import os, sys
from puckbench.jobs.fork_server import VARIABLE, start_fork_server
start_fork_server()
print(os.environ[VARIABLE], flush=True)
sys.stdin.read()
"""


@pytest.fixture
def server() -> Iterator[subprocess.Popen[str]]:
    """A process that has started a server; its name is in the environment of further processes."""
    starter = subprocess.Popen(
        [sys.executable, "-c", STARTER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=_hear_interrupts,  # noqa: PLW1509 (no other thread runs)
    )
    assert starter.stdout is not None
    with starter, pytest.MonkeyPatch.context() as patch:
        patch.setenv(fork_server.VARIABLE, starter.stdout.readline().strip())
        yield starter
        starter.kill()


@pytest.fixture
def job(tmp_path: Path) -> list[str]:
    """The words of a job that codes a cloud with a codec of its user's file."""
    points = np.random.default_rng(0).random((10, 3)) * 1023
    write_cloud(tmp_path / "cloud.ply", PointCloud(points, about={"size": 1024}))
    (tmp_path / "own.py").write_text(OWN)
    record = {"codec": "own", "rate": "r1", "changes": {"class": f"{tmp_path}/own.py:Own"}}
    files = [f"cloud={tmp_path}/cloud.ply", f"stream={tmp_path}/out.bin"]
    (tmp_path / "record.json").write_text(json.dumps(record))
    return [sys.executable, "-m", "puckbench.jobs", "encode", f"{tmp_path}/record.json", *files]


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
    stream = folder / "out.bin"
    found: dict[str, Any] = json.loads(stream.read_bytes()) if stream.exists() else {}
    stream.unlink(missing_ok=True)
    return done, found


@pytest.mark.usefixtures("server")
def test_a_forked_job_has_all_of_the_process_that_asked_for_it(
    job: list[str], tmp_path: Path
) -> None:
    done, found = _run(job, tmp_path, VARIABLE="value")
    assert (done.returncode, done.stderr) == (0, "said\n")
    assert json.loads(done.stdout)["job"] == "encode"
    assert found["forked"]
    assert found["folder"] == str(tmp_path)
    assert found["variable"] == "value"
    assert _run(job, tmp_path)[1]["variable"] is None


@pytest.mark.usefixtures("server")
def test_the_second_job_of_a_kind_finds_what_the_first_imported(
    job: list[str], tmp_path: Path
) -> None:
    inherited = [_run(job, tmp_path)[1]["numpy in the parent"] for _ in range(2)]
    assert inherited == [False, True]


@pytest.mark.usefixtures("server")
def test_jobs_with_other_threads_are_forked_from_other_processes(
    job: list[str], tmp_path: Path
) -> None:
    numbers = ["1", "2", "1", "2"]
    found = [_run(job, tmp_path, NUMBA_NUM_THREADS=number)[1] for number in numbers]
    assert [each["threads"] for each in found] == [1, 2, 1, 2]
    assert all(each["forked"] for each in found)


@pytest.mark.usefixtures("server")
def test_a_job_s_status_and_errors_come_to_who_asked(job: list[str], tmp_path: Path) -> None:
    (tmp_path / "cloud.ply").unlink()
    done, _ = _run(job, tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("puckbench: ")
    assert done.stderr.count("\n") == 1
    (tmp_path / "bad.json").write_text("{")
    done, _ = _run([*job[:4], f"{tmp_path}/bad.json", *job[5:]], tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"puckbench: {tmp_path}/bad.json: not valid JSON")


@pytest.mark.usefixtures("server")
def test_a_job_that_dies_again_by_itself_has_ended(job: list[str], tmp_path: Path) -> None:
    done, _ = _run(job, tmp_path, DIE="1")
    assert done.returncode == -signal.SIGKILL
    assert done.stderr == f"said\n{KILLED}said\n"


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize(
    "killed", [["job"], ["watcher"], ["server", "template", "watcher", "job"]], ids=" ".join
)
def test_a_job_whose_processes_are_killed_runs_again_by_itself(
    killed: list[str], job: list[str], tmp_path: Path
) -> None:
    asking, number = _begun(job, tmp_path)
    numbers = {"job": number}
    for parent, child in (("watcher", "job"), ("template", "watcher"), ("server", "template")):
        numbers[parent] = _parent(numbers[child])
    for name in killed:
        os.kill(numbers[name], signal.SIGKILL)
    said = asking.communicate()[1]
    assert (asking.returncode, said) == (0, f"said\n{KILLED}said\n")
    assert json.loads((tmp_path / "out.bin").read_bytes())["forked"] is False
    assert not _lives(number)


@pytest.mark.usefixtures("server")
def test_a_job_ends_with_the_process_that_asked_for_it(job: list[str], tmp_path: Path) -> None:
    asking, number = _begun(job, tmp_path)
    asking.kill()
    asking.communicate()  # until the job, which has the same streams, lets go of them
    while _lives(number):
        time.sleep(0.05)
    assert not (tmp_path / "out.bin").exists()


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


@pytest.mark.usefixtures("server")
def test_a_process_that_forks_jobs_is_replaced_when_it_dies(job: list[str], tmp_path: Path) -> None:
    first = _run(job, tmp_path)[1]["template"]
    os.kill(first, signal.SIGKILL)
    while _lives(first):
        time.sleep(0.05)
    found = _run(job, tmp_path)[1]
    assert found["forked"]
    assert found["template"] != first


def test_without_its_server_a_job_is_a_process_of_its_own(
    server: subprocess.Popen[str], job: list[str], tmp_path: Path
) -> None:
    assert _run(job, tmp_path)[1]["forked"]
    server.kill()  # the server sees it by the end of its standard input
    server.wait()
    while (answer := _run(job, tmp_path))[1].get("forked") is not False:
        time.sleep(0.05)
    assert answer[0].returncode == 0


@pytest.mark.usefixtures("server")
def test_another_python_does_not_use_the_server(job: list[str], tmp_path: Path) -> None:
    sources = os.environ.get("PYTHONPATH", "")
    done, found = _run(job, tmp_path, PYTHONPATH=os.pathsep.join(["/elsewhere", sources]))
    assert (done.returncode, found["forked"]) == (0, False)


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
