"""Progress of a long command: at a terminal one line, elsewhere a line now and then."""

import sys
import time

import pytest

from pointkit.terminal import Progress


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


def test_a_log_gets_a_line_every_ten_seconds_with_the_time_left(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    progress = Progress("frame")
    for second in range(1, 31):
        clock[0] = 100.0 + second
        progress(second * 400, 60_000)
    assert capsys.readouterr().err.splitlines() == [
        "frame 4,000 of 60,000, 140 s left",
        "frame 8,000 of 60,000, 130 s left",
        "frame 12,000 of 60,000, 120 s left",
    ]


def test_a_short_command_logs_nothing(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    progress = Progress("frame")
    clock[0] += 9
    progress(480, 480)
    assert capsys.readouterr().err == ""


def test_at_a_terminal_one_line_is_rewritten_and_ended(
    clock: list[float], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    progress = Progress("frame")
    progress(240, 480)
    progress(480, 480)
    printed = capsys.readouterr().err
    assert [line.strip() for line in printed.split("\r")] == [
        "",
        "frame 240 of 480, 0 s left",
        "frame 480 of 480, 0 s left",
    ]
    assert printed.endswith("\n")
