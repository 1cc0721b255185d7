"""Failed jobs by the ends of their logs."""

import os
from pathlib import Path

import pytest

from puckbench.core.yaml_files import read_yaml
from puckbench.planning.failures import Failure, failed_jobs, failure_lines, write_failures
from puckbench.planning.running import held_since, hold_results

DONE = '{"job": "evaluate_curve", "processor_s": 1.0, "wall_s": 1.0}'


def _log(path: Path, *lines: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines))


def test_errors_of_this_run_are_told_once_each_with_a_log(tmp_path: Path) -> None:
    _log(tmp_path / "old.log", "puckbench: of another run")
    hold_results(tmp_path)
    _log(tmp_path / "coded" / "d" / "a" / "c.log", "rate 1 of 8", "puckbench: codec c: disk full")
    _log(tmp_path / "coded" / "d" / "b" / "c.log", "puckbench: codec c: disk full")
    _log(tmp_path / "scans" / "s.log", "puckbench: remark", DONE)
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
    ],
)
def test_a_log_without_a_message_tells_how_its_process_ended(
    tmp_path: Path, lines: tuple[str, ...], reason: str
) -> None:
    _log(tmp_path / "clouds" / "d" / "a.log", *lines)
    (failure,) = failed_jobs(tmp_path, since=0.0)
    assert (failure.dataset, failure.cloud, failure.codec) == ("d", "a", "")
    assert reason in failure.reason


def test_of_many_errors_some_are_told(tmp_path: Path) -> None:
    for number in range(15):
        _log(tmp_path / f"{number:02}.log", f"puckbench: fault {number}")
    lines = list(failure_lines(failed_jobs(tmp_path, since=0.0)))
    assert len(lines) == 11
    assert lines[-1] == "puckbench: 5 more errors, in the logs"


def test_failed_clouds_and_curves_are_a_configuration(tmp_path: Path) -> None:
    curve = Failure("d", "a", "c", "codec c, cloud d/a", "disk full", Path("a.log"))
    cloud = Failure("d", "b", "", "clouds/d/b", "no room", Path("b.log"))
    path = write_failures(tmp_path / "failed.yaml", [curve, cloud])
    assert path is not None
    assert read_yaml(path) == {
        "failed": {"d/a/c": "disk full; log: a.log", "d/b": "no room; log: b.log"}
    }
    table = Failure("", "", "", "tables/x", "no rows", Path("x.log"))
    assert write_failures(path, [curve, table]) is None
    assert not path.exists()


def test_clouds_that_a_configuration_excluded_stay_excluded(tmp_path: Path) -> None:
    path, before = tmp_path / "failed.yaml", {"d/a": "damaged; log: a.log"}
    assert write_failures(path, [], {}) is None
    cloud = Failure("d", "b", "", "clouds/d/b", "no room", Path("b.log"))
    assert write_failures(path, [cloud], before) == path
    everything = {"failed": {**before, "d/b": "no room; log: b.log"}}
    assert read_yaml(path) == everything
    table = Failure("", "", "", "tables/x", "no rows", Path("x.log"))
    assert write_failures(path, [table], before) is None
    assert read_yaml(path) == everything
