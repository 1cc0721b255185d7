"""Parsers in a worker process: results, faults and limits."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from pointkit import isolated as module
from pointkit.errors import InputError
from pointkit.isolated import ParsedFile, parse_isolated, parser_limits


def number(path: Path, times: int = 1) -> ParsedFile:
    print("what parsers print is not taken for an answer")  # noqa: T201
    logging.getLogger("puckbench.tests").warning("%s: read", path)
    value = int(path.read_text()) * times
    arrays = {"value": np.array([value], ">i2"), "none": np.zeros((0, 3)), "on": np.ones(2, bool)}
    return ParsedFile(arrays, {"process": os.getpid(), "folder": str(Path.cwd())})


def refuses(path: Path) -> ParsedFile:
    raise InputError(f"{path}: no good")


def aborts(path: Path) -> ParsedFile:
    os.abort()


def panics(path: Path) -> ParsedFile:
    raise BaseException(path)


def raises(path: Path) -> ParsedFile:
    return ParsedFile({"value": np.array([1 / 0])})


def hoards(path: Path) -> ParsedFile:
    return ParsedFile({"values": np.ones(3 << 30, np.uint8)})


def works_for_ever(path: Path) -> ParsedFile:
    while True:
        pass


def fills_the_disk(path: Path) -> ParsedFile:
    with Path(f"{path}.out").open("wb") as stream:
        stream.truncate(3 << 30)
    return ParsedFile({})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    place = tmp_path / "a"
    place.write_text("7")
    return place


def test_arrays_and_warnings_are_returned(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        parsed = parse_isolated(number, path, "number", {"times": 3})
    assert parsed.columns["value"].tolist() == [21]
    assert parsed.columns["value"].dtype == np.dtype(">i2")
    assert parsed.columns["none"].shape == (0, 3)
    assert parsed.columns["on"].all()
    assert parsed.about["process"] != os.getpid()
    assert [record.getMessage() for record in caplog.records] == [f"{path}: read"]


def test_one_process_reads_many_files(path: Path) -> None:
    assert len({parse_isolated(number, path, "number").about["process"] for _ in range(3)}) == 1


def test_a_path_is_relative_to_the_caller(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parse_isolated(number, path, "number")
    monkeypatch.chdir(path.parent)
    assert parse_isolated(number, Path("a"), "number").about["folder"] == str(path.parent.resolve())


def test_an_input_error_is_passed_on_and_the_process_kept(path: Path) -> None:
    before = parse_isolated(number, path, "number").about["process"]
    with pytest.raises(InputError, match=r"a: no good$"):
        parse_isolated(refuses, path, "number")
    assert parse_isolated(number, path, "number").about["process"] == before


@pytest.mark.parametrize("parse", [aborts, panics, raises])
def test_a_crash_is_one_line_and_the_next_file_is_read(
    parse: Callable[[Path], ParsedFile], path: Path
) -> None:
    with pytest.raises(InputError) as refusal:
        parse_isolated(parse, path, "LAZ file")
    assert str(refusal.value) == f"{path}: not a readable LAZ file (its parser crashes)"
    assert parse_isolated(number, path, "number").columns["value"] == 7


def test_memory_is_limited(path: Path) -> None:
    with pytest.raises(InputError, match=r"a: not a readable file \(.* more than 2 GiB\)"):
        parse_isolated(hoards, path, "file")


def test_files_are_limited(path: Path) -> None:
    with pytest.raises(InputError, match="its parser crashes"):
        parse_isolated(fills_the_disk, path, "file")


def test_time_is_limited(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MIN_SECONDS", 1)
    with pytest.raises(InputError, match=r"a: not a readable file \(.* more than 1 s\)"):
        parse_isolated(works_for_ever, path, "file")


def sleeps(path: Path) -> ParsedFile:
    time.sleep(600)
    return ParsedFile({})


def test_a_parser_that_waits_is_ended(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_CLOCK_FACTOR", 0.01)
    with pytest.raises(InputError, match="more than 10 s"):
        parse_isolated(sleeps, path, "file")


def test_limits_grow_with_the_file() -> None:
    assert parser_limits(1000) == (2 << 30, 10)
    assert parser_limits(10**9) == (40 * 10**9, 1010)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="b: no such file"):
        parse_isolated(number, tmp_path / "b", "number")


def test_forks_and_threads_have_separate_workers(path: Path) -> None:
    ours = parse_isolated(number, path, "number").about["process"]
    with get_context("fork").Pool(2) as pool:
        theirs = pool.map(_process, [path] * 4)
    assert ours not in theirs
    threads = [Thread(target=_process, args=(path,)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert parse_isolated(number, path, "number").columns["value"] == 7


def _process(path: Path) -> int:
    return int(parse_isolated(number, path, "number").about["process"])
