"""Failed jobs by the ends of their logs."""

import os
from pathlib import Path

import pytest

from pointkit.yaml_files import read_yaml
from puckbench.planning.failures import (
    Failure,
    described,
    failed_jobs,
    failure_lines,
    write_failures,
)
from puckbench.planning.running import held_since, hold_results

DONE = '{"job": "evaluate", "processor_s": 1.0, "wall_s": 1.0}'


def _log(path: Path, *lines: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines))


def test_errors_of_this_run_are_told_once_each_with_a_log(tmp_path: Path) -> None:
    _log(tmp_path / "old.log", "puckbench: of another run")
    hold_results(tmp_path)
    _log(tmp_path / "coded" / "d" / "a" / "c.log", "rate 1 of 8", "puckbench: codec c: disk full")
    _log(tmp_path / "coded" / "d" / "b" / "c.log", "puckbench: codec c: disk full")
    _log(tmp_path / "scans" / "s.log", "puckbench: remark", DONE)
    _log(tmp_path / "scans" / "t.log", f"50 %{DONE}")
    os.utime(tmp_path / "old.log", (held_since() - 0.01,) * 2)
    (line,) = failure_lines(failed_jobs(tmp_path, held_since()))
    log = tmp_path / "coded" / "d" / "a" / "c.log"
    assert line == (f"puckbench: codec c, cloud d/a: disk full; log: {log} (and 1 more)")


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ((), "the process was killed"),
        (("loading",), "the process was killed"),
        (("Fatal Python error: Segmentation fault", "", "  File"), "died: Segmentation fault"),
        (("Timeout (0:00:10)!", "Thread 0x1"), "longer than its limit of 0:00:10"),
        (("Timeout (0:00:10)!", "  File", "exit status 1"), "longer than its limit of 0:00:10"),
        (("loading", "exit status 3"), "the process ended itself with exit status 3"),
        (("50 %exit status 3",), "the process ended itself with exit status 3"),
        (("killed by signal 9 (SIGKILL)",), "killed by signal 9 (SIGKILL; out of memory?)"),
        (("50 %puckbench: disk full",), "disk full"),
    ],
)
def test_a_log_without_a_message_tells_how_its_process_ended(
    tmp_path: Path, lines: tuple[str, ...], reason: str
) -> None:
    _log(tmp_path / "clouds" / "d" / "a.log", *lines)
    (failure,) = failed_jobs(tmp_path, since=0.0)
    assert (failure.job, failure.codec) == ("clouds/d/a", "")
    assert reason in failure.reason


def test_of_many_errors_some_are_told(tmp_path: Path) -> None:
    for number in range(15):
        _log(tmp_path / f"{number:02}.log", f"puckbench: fault {number}")
    lines = list(failure_lines(failed_jobs(tmp_path, since=0.0)))
    assert len(lines) == 11
    assert lines[-1] == "puckbench: 5 more errors, in the logs"


def test_failed_jobs_are_a_configuration(tmp_path: Path) -> None:
    curve = Failure("coded/d/a/c", "disk full", Path("a.log"))
    table = Failure("tables/x", "no rows", Path("x.log"))
    path = write_failures(tmp_path / "failed.yaml", [curve, table], {})
    assert path is not None
    reasons = {"coded/d/a/c": "disk full; log: a.log", "tables/x": "no rows; log: x.log"}
    assert read_yaml(path) == {"failed": reasons}


def test_what_a_configuration_excluded_stays_excluded(tmp_path: Path) -> None:
    path, before = tmp_path / "failed.yaml", {"clouds/d/a": "damaged; log: a.log"}
    cloud = Failure("clouds/d/b", "no room", Path("b.log"))
    assert write_failures(path, [cloud], before) == path
    assert read_yaml(path) == {"failed": {**before, "clouds/d/b": "no room; log: b.log"}}


@pytest.mark.parametrize(
    "failure",
    [
        Failure("report", "disk full", Path("report.log")),
        Failure("reference", "disk full", Path("reference.log")),
        Failure("coded/d/a/c", "interrupted", Path("c.log")),
        Failure("clouds/d/a", "damaged", Path("a.log")),  # which the run had excluded
    ],
    ids=lambda failure: str(failure.job),
)
def test_without_a_further_job_to_leave_out_no_run_can_make_the_rest(
    failure: Failure, tmp_path: Path
) -> None:
    path, before = tmp_path / "failed.yaml", {"clouds/d/a": "damaged; log: a.log"}
    assert write_failures(path, [failure], before) is None
    assert not path.exists()


@pytest.mark.parametrize(
    ("job", "words"),
    [
        ("coded/d/a/c", "codec c, cloud d/a"),
        ("decoded/d/a/c/r1", "codec c, cloud d/a, r1"),
        ("drive_tasks/d/a/c", "codec c, drive d/a"),
        ("drive_tasks/d/a/undecoded", "drive d/a, undecoded"),
        ("scenes/rooms/office_1", "scene rooms/office_1"),
        ("scans/d/a", "scan d/a"),
        ("tables/x", "table x"),
        ("figures/x", "figure x"),
        ("first_look", "first_look"),
        ("residuals/models/vlp16", "residuals/models/vlp16"),
    ],
)
def test_a_job_is_named_in_words(job: str, words: str) -> None:
    assert described(job) == words


@pytest.mark.parametrize(
    ("kind", "archive"), [("metrics", "coded"), ("drive_tasks", "coded_drives")]
)
def test_a_reason_does_not_repeat_codec_and_cloud(kind: str, archive: str, tmp_path: Path) -> None:
    fault = f"puckbench: rate r1: my results/{archive}/d/a/c.zip: codec c: damaged"
    _log(tmp_path / kind / "d" / "a" / "c.log", fault)
    (failure,) = failed_jobs(tmp_path, since=0.0)
    assert failure.reason == "rate r1: damaged"
