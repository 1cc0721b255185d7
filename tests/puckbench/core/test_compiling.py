"""Machine code is cached on disk, and not used when another file that it holds code of changes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pointkit.compiling import CompilingNotice
from pointkit.sources import loops_folder

SOURCE = Path(__file__).parents[3] / "src"
OUTER = """
from inner import inner
from pointkit.compiling import compiled

@compiled
def outer():
    return inner() + 1

print(outer(), outer.stats.cache_hits[()] if () in outer.stats.cache_hits else 0)
"""
PRINT = OUTER[OUTER.index("print(") :]
INNER = """
from pointkit.compiling import compiled

@compiled
def inner():
    return {value}
"""


_COMPILED = shutil.ignore_patterns("__pycache__")


def _run(folder: Path, source: Path = SOURCE, more: dict[str, str] | None = None) -> str:
    environment = {**os.environ, "PYTHONPATH": f"{source}:{folder}"}
    for name in ("NUMBA_CACHE_DIR", "NUMBA_BOUNDSCHECK"):
        environment.pop(name, None)
    environment |= more or {}
    done = subprocess.run(
        [sys.executable, folder / "outer.py"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_a_cached_function_follows_the_one_it_calls(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(OUTER)
    (tmp_path / "inner.py").write_text(INNER.format(value=1))
    assert _run(tmp_path) == "2 0"
    assert _run(tmp_path) == "2 1"
    (tmp_path / "inner.py").write_text(INNER.format(value=5))
    assert _run(tmp_path) == "6 0"


def test_a_cached_function_follows_one_of_another_room(tmp_path: Path) -> None:
    """In a copy of the package, so that its sources can be edited."""
    package = tmp_path / "puckbench"
    shutil.copytree(SOURCE / "puckbench" / "core", package / "core", ignore=_COMPILED)
    for room in (package, package / "near", package / "far"):
        room.mkdir(exist_ok=True)
        (room / "__init__.py").write_text("")
    (package / "near" / "outer.py").write_text(
        OUTER.replace("from inner", "from puckbench.far.inner").split("print(")[0]
    )
    (tmp_path / "outer.py").write_text(f"from puckbench.near.outer import outer\n{PRINT}")
    inner = package / "far" / "inner.py"
    inner.write_text(INNER.format(value=1))
    assert _run(tmp_path, tmp_path) == "2 0"
    assert _run(tmp_path, tmp_path) == "2 1"
    inner.write_text(INNER.format(value=5))
    assert _run(tmp_path, tmp_path) == "6 0"


OUTSIDE = """
import numpy as np
from pointkit.compiling import compiled, compiled_in_place

@compiled_in_place
def last(values, at):
    return values[at]

@compiled
def outer(count, at):
    return last(np.zeros(count), at)

try:
    outer(3, 3)
    print("read")
except IndexError:
    print("refused")
"""


@pytest.mark.parametrize(("checks", "found"), [("", "read"), ("1", "refused")])
def test_indices_are_checked_on_demand_with_a_cache_of_their_own(
    tmp_path_factory: pytest.TempPathFactory, checks: str, found: str
) -> None:
    folder = tmp_path_factory.getbasetemp() / "checked_indices"
    folder.mkdir(exist_ok=True)
    (folder / "outer.py").write_text(OUTSIDE)
    changed = {"NUMBA_BOUNDSCHECK": checks} if checks else {}
    assert _run(folder, more=changed) == found


def test_loops_are_kept_beside_their_sources_or_where_the_user_may_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert loops_folder(tmp_path) == tmp_path / "__pycache__"
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # as in a container
    monkeypatch.setenv("XDG_CACHE_HOME", "/caches")
    assert loops_folder(tmp_path) == Path("/caches/puckbench")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/someone")
    assert loops_folder(tmp_path) == Path("/home/someone/.cache/puckbench")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/chosen")
    assert loops_folder(tmp_path) == Path("/chosen")


def test_long_compilation_is_told_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("pointkit.compiling.time.monotonic", lambda: now[0])
    notice = CompilingNotice()
    event: Any = None
    for seconds in (1.0, 1.0, 2.0, 1.0):
        assert not notice.is_printed
        notice.on_start(event)
        notice.on_start(event)  # of a loop that the first one calls
        now[0] += seconds
        notice.on_end(event)
        notice.on_end(event)
        now[0] += 100.0  # work between compilations does not count
    notice.on_start(event)
    assert capsys.readouterr().err.splitlines() == [
        "compiling loops for this machine, once: this takes up to two minutes"
    ]


TIMED = """
import time
from pointkit import compiling

clock = time.monotonic
compiling.time.monotonic = lambda: 10 * clock()
compiling._SECONDS_UNTIL_NOTICE = 0.0

@compiling.compiled
def inner():
    return 1

@compiling.compiled
def outer():
    return inner()

print(outer())
"""


def test_compiling_is_told_on_standard_error_and_loading_is_not(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(TIMED)
    environment = {**os.environ, "PYTHONPATH": str(SOURCE)}
    environment.pop("NUMBA_CACHE_DIR", None)
    for line_count in (1, 0):
        done = subprocess.run(
            [sys.executable, tmp_path / "outer.py"],
            env=environment, capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert done.stdout == "1\n"
        assert done.stderr.count("compiling") == line_count
