"""Codecs with a fault get the line of the check that finds it, and right ones get none."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from puckbench.checks.clouds import SIDE, least_bits, random_points
from puckbench.checks.elsewhere import opened
from puckbench.checks.registry import Outcome, checks
from puckbench.checks.subject import Subject, kinds_of
from puckbench.checks.supervision import run_check
from puckbench.cli import main

RIGHT = ["Right", "InMetres", "Attributed"]
FAULTS: dict[str, dict[str, str]] = {
    "ChangesItsInput": {"round_trip": "encode changes the points"},
    "ReturnsAList": {"round_trip": "decode returned list, not a PointCloud: encode and decode"},
    "ForgetsItsStep": {"distances": "its step or origin is wrong"},
    "LosesPoints": {"distances": "points are lost"},
    "Thins": {"distances": "of the points are lost: no decoded point is within"},
    "IgnoresTheLength": {"distances": "a cell of the rate's step", "any_length": "use `step_m`"},
    "KnowsItsRatesAlone": {"any_length": "KeyError '15mm': users may name any length"},
    "InWrongOrder": {"order_of_rates": "fewer bytes than r4"},
    "IgnoresTheRate": {"order_of_rates": "use the parameters of the rate"},
    "NeedsTwoPoints": {"one_point": "IndexError: index 1 is out of bounds"},
    "DividesByTheDistance": {"equal_points": "distance between points, which may be 0"},
    "DividesByTheHeight": {"lines_and_planes": "extent along an axis, which may be 0"},
    "Remembers": {"new_process": "r1: a new process does not decode the stream (InputError"},
    "WritesTemporaryFiles": {"new_process": "No such file or directory"},
    "WritesBesideItself": {"side_information": ".side, which encode has written: put all"},
    "WritesByPrograms": {"side_information": "72 bits for 400 random points, and errors up to"},
    "LeavesALog": {"side_information": "encode leaves"},
    "Varies": {"determinism": "r1: a second encoding gives other bytes"},
    "Wavers": {
        "determinism": "r1: a second decoding gives other points",
        "new_process": "r1: a new process decodes other points",
    },
    "WritesASet": {"new_process": "r1: a new process encodes other bytes: sort"},
    "SharesTooMuch": {"shared_work": "other bytes if another rate was coded before"},
    "DropsColours": {"attributes": "no colour comes back: encode that of"},
    "MixesReflectances": {"attributes": "reflectance is off by"},
    "RaisesOnDamage": {"damage": "the empty stream: error: Error -5"},
    "SleepsOnDamage": {"damage": "the empty stream: takes 6 s: compare announced sizes"},
    "TakesMemoryOnDamage": {"damage": "takes more than 2 GiB"},
    "HasNoVersion": {"version": 'set `version = "1"`'},
    "ExplainsAtLength": {"skip": "return a reason in one line"},
    "TakesLong": {"cost": "4 times as many points take"},
    "TakesLongerThanPlanned": {"cost": "runs plan 2.1 s: set costs = "},
}
ADVICE = {"LeavesALog", "HasNoVersion", "TakesLong", "TakesLongerThanPlanned"}
"""Codecs that work, but should be changed."""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A file of the codecs in a folder of its own, where some of them write."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return f"{shutil.copy(Path(__file__).with_name('faulty.py'), tmp_path)}:"


def outcomes(place: str) -> dict[str, tuple[Outcome, str]]:
    """How each check ends, in this process."""
    codec = opened(place, {})
    (kind,) = kinds_of(codec)
    subject = Subject(codec, kind)
    ends: dict[str, tuple[Outcome, str]] = {}
    for check in checks():
        ends[check.name] = run_check(check, subject)
        if ends["round_trip"][0] == "failed":
            break
    return ends


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_codec_passes(name: str, place: str) -> None:
    assert {end for end, _ in outcomes(place + name).values()} == {"passed", "left out"}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_the_line_of_its_check(name: str, place: str) -> None:
    ends = outcomes(place + name)
    found = {check: line for check, (end, line) in ends.items() if end in ("failed", "advice")}
    assert found.keys() == FAULTS[name].keys(), found
    for check, line in found.items():
        assert FAULTS[name][check] in line
        assert len(line.splitlines()) == 1
        assert ends[check][0] == ("advice" if name in ADVICE else "failed")


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("Exits", "round trip, scaled          the codec's process is gone: it ended with exit"),
        ("ExitsOnOnePoint", "one point, scaled           the codec's process is gone: it ended"),
        ("CallsExit", "round trip, scaled          SystemExit: exit status 4 (faulty.py:"),
        ("FailsToLoad", "loading                     RuntimeError: no licence (faulty.py:"),
    ],
)
def test_a_codec_that_ends_its_process_is_told(
    name: str, line: str, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", place + name]) == 1
    lines = capsys.readouterr().out.splitlines()
    (failed,) = [each for each in lines if each.startswith("failed") and len(each) > 20]
    assert failed.startswith(f"failed    {line}")
    assert lines[-3:-1] == ["failed    1", "advice    0"]
    if name == "ExitsOnOnePoint":
        assert lines[-4] == "passed    13"


def test_a_codec_that_changes_the_folder_passes(
    place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path.cwd()
    assert main(["check", place + "Moves", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["failed"] == answer["advice"] == 0
    assert Path.cwd() == folder


def test_programs_that_a_codec_leaves_are_ended(
    place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    start = time.perf_counter()
    assert main(["check", place + "StartsPrograms"]) == 0
    assert time.perf_counter() - start < 60
    assert b"sleep\0001234\0" not in _commands()


def _commands() -> set[bytes]:
    """The commands of all processes."""
    commands = set()
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            commands.add(file.read_bytes())
    return commands


def test_a_codec_that_hangs_is_ended(
    place: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first = checks()[0]
    monkeypatch.setattr(
        "puckbench.checks.supervision.checks", lambda: [first._replace(seconds=4), *checks()[1:]]
    )
    assert main(["check", place + "HangsInDecode"]) == 1
    assert "it did not end within 4 s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("codec", "line"),
    [
        ("nothing_of_the_kind", "unknown codec 'nothing_of_the_kind'"),
        ("faulty.py:Missing", "cannot load 'faulty.py:Missing'"),
        ("tmc13", "codec tmc13 cannot run here: no program 'tmc3'"),
    ],
)
def test_what_is_no_codec_is_bad_input(
    codec: str,
    line: str,
    place: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(Path(place).parent)
    monkeypatch.setenv("PATH", os.defpath)
    assert main(["check", codec]) == 2
    captured = capsys.readouterr()
    assert line in captured.err
    assert len(captured.err.splitlines()) == 1
    assert not captured.out


def test_random_points_need_the_bits_of_their_choice() -> None:
    """Stored one after the other in order, points need little more."""
    points = random_points(400)
    assert len(np.unique(points, axis=0)) == 400
    exact = least_bits(400, 400, np.zeros(400))
    sorted_codes = 400 * 30 - np.log2(np.arange(1, 401, dtype=float)).sum()  # log2(N^n / n!)
    assert 0.85 * sorted_codes < exact < sorted_codes
    for step in (2, 16, 128):  # cells of a right grid
        errors = np.full(400, step * 3**0.5 / 2)
        right = 400 * 3 * np.log2(SIDE / step) - np.log2(np.arange(1, 401, dtype=float)).sum()
        assert least_bits(400, 400, errors) < right
    assert least_bits(400, 400, np.full(400, 2000.0)) < 0
