"""Times of a finished run's jobs, and what they say of another run."""

import json
import subprocess
import sys
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from puckbench.core.environment import source_commit
from puckbench.core.errors import InputError
from puckbench.planning.job_times import JobKind, JobTime, Measurements, estimated, read_job_times


def times(rule: str, *pairs: tuple[int, float], codec: str = "", rates: int = 0) -> list[JobTime]:
    return [JobTime(rule, codec, rates, points, seconds) for points, seconds in pairs]


def test_a_job_takes_a_start_and_a_time_for_each_point() -> None:
    result = Measurements.of([(100_000, 0.5), (200_000, 0.7), (300_000, 0.9)])
    assert result.at(1_000_000) == pytest.approx(0.3 + 2e-6 * 1_000_000)


def test_with_one_size_alone_time_is_in_proportion_to_the_points() -> None:
    result = Measurements.of([(500_000, 2.0), (500_000, 3.0), (500_010, 2.5)])
    assert result.at(1_000_000) == pytest.approx(5.0, rel=1e-3)


def test_neither_start_nor_time_for_a_point_is_negative() -> None:
    falling = Measurements.of([(100, 3.0), (300, 1.0)])
    assert falling.at(1000) == pytest.approx(2.0)
    steep = Measurements.of([(100, 0.0), (300, 4.0)])
    assert steep.at(0) == 0.0


def test_the_first_job_of_a_run_which_compiles_does_not_tilt_the_line() -> None:
    result = Measurements.of([(100, 90.0), (100, 1.0), (200, 2.0), (300, 3.0), (400, 4.0)])
    assert result.at(1000) == pytest.approx(10.0)


def test_timed_calls_count_as_often_as_they_are_planned() -> None:
    measured = [JobTime("encode_curve", "draco", 8, 100, 3.0, call_s=0.5, repeats=2)]
    (result,) = estimated([JobKind("encode_curve", 1, 100, "draco", 8, repeats=5)], measured)
    assert result.seconds == pytest.approx(2.0 + 5 * 0.5)


def test_jobs_measured_against_the_truth_tell_of_their_like() -> None:
    measured = [
        JobTime("evaluate_curve", "draco", 8, 100, 1.0, truth=False),
        JobTime("evaluate_curve", "draco", 8, 100, 4.0, truth=True),
    ]
    kinds = [JobKind("evaluate_curve", 1, 100, "draco", 8, truth=truth) for truth in (False, True)]
    assert [result.seconds for result in estimated(kinds, measured)] == [1.0, 4.0]


def test_core_hours_count_every_job_and_say_how_far_they_reach() -> None:
    kind = JobKind("encode_curve", 3600, 200, "draco", 8)
    measured = times("encode_curve", (100, 1.0), (100, 1.0), codec="draco", rates=8)
    (result,) = estimated([kind], measured)
    assert result.hours == pytest.approx(2.0)
    assert (result.measured, result.reach, result.exact) == (2, 2.0, True)


def test_a_curve_of_more_rates_takes_longer_in_proportion_and_says_so() -> None:
    measured = times("encode_curve", (100, 1.0), codec="draco", rates=2)
    kinds = [JobKind("encode_curve", 1, 100, codec, 8) for codec in ("draco", "gpcc")]
    draco, gpcc = estimated(kinds, measured)
    assert (draco.seconds, draco.exact) == (4.0, False)
    assert (gpcc.seconds, gpcc.hours) == (None, 0.0)


def ended(
    run: Path, job: str, log: str, seconds: float, wall_s: float = 0.0, **work: object
) -> None:
    path = run / log
    path.parent.mkdir(parents=True, exist_ok=True)
    cost = {"job": job, "processor_s": seconds, "wall_s": wall_s or seconds, "peak_mib": 90}
    cost |= {"work": work}
    path.write_text(f"some words\n{json.dumps(cost)}\n")


def test_logs_become_one_time_for_each_job_that_ended(tmp_path: Path) -> None:
    about = tmp_path / "results" / "small" / "clouds" / "objects" / "chair_01.json"
    about.parent.mkdir(parents=True)
    about.write_text('{"points": 2000}')
    log = "results/small/logs/coded/objects/chair_01/draco.log"
    ended(tmp_path, "encode_curve", log, 1.5, codec="draco", rates=8, repeats=1, call_s=0.5)
    ended(tmp_path, "figure", "results/small/logs/figures/fig_6_5.log", 4.0)
    (tmp_path / "results/small/logs/failed.log").write_text("puckbench: no such file")
    (tmp_path / "results/small/logs/empty.log").write_text("")
    result = sorted(read_job_times(tmp_path), key=lambda time: time.job)
    assert result == [
        JobTime("encode_curve", "draco", 8, 2000, 1.5, call_s=0.5, repeats=1, peak_mib=90),
        JobTime("figure", "", 0, 0, 4.0, peak_mib=90),
    ]


def test_timed_calls_took_the_processor_as_the_whole_job_did(tmp_path: Path) -> None:
    log = "results/logs/metrics/rooms/office_1/gpcc/r1_to_r4.log"
    work = {"codec": "gpcc", "rates": 4, "repeats": 3, "call_s": 0.5, "truth": True}
    ended(tmp_path, "evaluate_curve", log, 4.0, wall_s=8.0, **work)
    (result,) = read_job_times(tmp_path)
    assert (result.call_s, result.repeats, result.truth) == (0.25, 3, True)  # half of the processor


def test_the_cost_of_a_process_counts_what_it_waited_for() -> None:
    program = (
        "import subprocess, sys; from puckbench.jobs.cost import cost_line;"
        "subprocess.run([sys.executable, '-c', 'x = bytearray(200 << 20); sum(range(3_000_000))']);"
        "print(cost_line('scan', {'points': 7}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    cost = json.loads(done.stdout)
    assert (cost["job"], cost["work"]) == ("scan", {"points": 7})
    assert cost["peak_mib"] >= 200
    assert datetime.fromisoformat(cost["ended"]).utcoffset() == timedelta(0)
    assert cost.get("commit", "") == source_commit()
    assert 0.02 < cost["processor_s"] <= cost["wall_s"] * 1.5


def test_a_folder_without_a_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no logs of finished jobs"):
        read_job_times(tmp_path)
