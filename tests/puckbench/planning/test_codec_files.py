"""Programs of external codecs count by their content."""

from __future__ import annotations

from pathlib import Path

import pytest

from puckbench.codecs.external import ExternalCodec
from puckbench.codecs.registry import open_codec
from puckbench.planning.codec_files import program_digests
from puckbench.planning.memory import Memory


def program(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def digests(codec: ExternalCodec, results: Path) -> list[str]:
    """As a run sees them, which remembers them for the next one."""
    memory = Memory(results)
    found = program_digests(codec, memory)
    memory.save()
    return found


@pytest.fixture
def tmc13(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ExternalCodec:
    """A codec whose program is searched for in a folder of its own."""
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    codec = open_codec("tmc13")
    assert isinstance(codec, ExternalCodec)
    return codec


def test_another_program_of_the_name_is_noticed(tmc13: ExternalCodec, tmp_path: Path) -> None:
    results = tmp_path / "results"
    assert digests(tmc13, results) == [""]
    program(tmp_path / "bin" / "tmc3", "echo 14")
    (first,) = digests(tmc13, results)
    program(tmp_path / "bin" / "tmc3", "echo 23")
    (second,) = digests(tmc13, results)
    assert len({"", first, second}) == 3


def test_a_missing_program_is_as_it_was(tmc13: ExternalCodec, tmp_path: Path) -> None:
    file = program(tmp_path / "bin" / "tmc3", "echo 14")
    known = digests(tmc13, tmp_path / "results")
    file.unlink()
    assert digests(tmc13, tmp_path / "results") == known
    assert digests(tmc13, tmp_path / "others") == [""]


def test_the_same_program_in_another_folder_is_no_other(
    tmc13: ExternalCodec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = program(tmp_path / "bin" / "tmc3", "echo 14")
    known = digests(tmc13, tmp_path / "a")
    (tmp_path / "elsewhere").mkdir()
    file.rename(tmp_path / "elsewhere" / "tmc3")
    monkeypatch.setenv("PATH", str(tmp_path / "elsewhere"))
    assert digests(tmc13, tmp_path / "b") == known


def test_codecs_without_programs_have_no_digest(tmp_path: Path) -> None:
    assert program_digests(open_codec("draco"), Memory(tmp_path)) == []
