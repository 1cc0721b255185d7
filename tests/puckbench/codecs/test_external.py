"""Programs run under limits, and the adapters of TMC13 and Draco's tools where those are there."""

import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.measurement import Cost
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import cost_of, why_not_here
from puckbench.codecs.external import ExternalCodec, folder
from puckbench.codecs.registry import codec_of, open_codec
from tests.support.codecs import decode, encode

PROGRAMS = {"tmc13": "tmc3", "draco_cli": "draco_encoder"}


class Python(ExternalCodec):
    programs = (sys.executable,)

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        return cloud.xyz.tobytes()

    def decode(self, stream: bytes) -> PointCloud:
        return PointCloud(np.frombuffer(stream).reshape(-1, 3))

    def do(self, program: str, tmp_path: Path) -> None:
        (tmp_path / "in").write_bytes(b"")
        self.run((sys.executable, "-I", "-S", "-c", program), tmp_path / "in")


@pytest.fixture
def python() -> Python:
    return Python(name="python", rates={})


def test_the_cost_is_that_of_the_program_alone(python: Python, tmp_path: Path) -> None:
    ballast = np.ones(200 * 2**17)  # 200 MiB of ours
    begun = time.perf_counter()
    python.do("import time; x = bytearray(50 * 2**20); time.sleep(0.2)", tmp_path)
    passed = time.perf_counter() - begun
    cost = cost_of(python, Cost(1e9, 1e9))
    assert 50 <= cost.peak_mib < 100
    assert 0.2 <= cost.seconds <= passed
    assert ballast.size


class Twice(Python):
    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        with folder() as path:
            self.do("import time; time.sleep(0.1)", path)
            self.do("import time; time.sleep(0.1); x = bytearray(50 * 2**20)", path)
        return super().encode(cloud, rate)


def test_a_call_costs_what_all_its_programs_cost_and_nothing_of_earlier_calls() -> None:
    codec = Twice(name="twice", rates={"r1": {}})
    for _ in range(2):
        encode(codec, np.ones((3, 3)), "r1")
        cost = cost_of(codec, Cost(1e9, 1e9))
        assert 0.2 <= cost.seconds < 2
        assert 50 <= cost.peak_mib < 100
    decode(codec, np.ones((3, 3)).tobytes())
    assert cost_of(codec, Cost(1.0, 2.0)) == Cost(1.0, 2.0)


@pytest.mark.parametrize(
    ("program", "fault"),
    [
        ("raise SystemExit(7)", r"python\S* failed \(7: "),
        ("import os; os.abort()", r"failed \(-6: "),
        ("raise ValueError('no such thing')", "no such thing"),
        ("x = bytearray(3 * 2**30)", "MemoryError"),
    ],
    ids=["status", "abort", "words", "memory"],
)
def test_a_program_that_fails_ends_in_one_line(
    python: Python, tmp_path: Path, program: str, fault: str
) -> None:
    with pytest.raises(InputError, match=fault) as caught:
        python.do(program, tmp_path)
    assert "\n" not in str(caught.value)


def test_a_program_that_hangs_is_ended(
    python: Python, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("puckbench.codecs.external._SECONDS", 1)
    with pytest.raises(InputError, match=r"failed \(-9: "):
        python.do("import time; time.sleep(60)", tmp_path)


def test_a_program_that_does_not_exist_ends_in_one_line(python: Python, tmp_path: Path) -> None:
    (tmp_path / "in").write_bytes(b"")
    with pytest.raises(InputError, match="nothing_of_the_kind failed"):
        python.run(("nothing_of_the_kind",), tmp_path / "in")


@pytest.mark.parametrize("name", PROGRAMS)
def test_absent_programs_are_reported(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nonexistent")
    codec = open_codec(name)
    assert why_not_here(codec) == f"no program '{PROGRAMS[name]}'"
    assert isinstance(codec.version, str)


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_can_be_named_in_the_configuration(name: str, tmp_path: Path) -> None:
    tool = tmp_path / "tool"
    tool.write_text("#!/bin/sh\nexit 3\n")
    tool.chmod(0o755)
    options = {"tmc13": {"program": str(tool)}}.get(
        name, {"encoder": str(tool), "decoder": str(tool)}
    )
    codec = open_codec(name, {"options": options})
    assert not why_not_here(codec)
    with pytest.raises(InputError, match=f"codec {name}: tool failed"):
        encode(codec, np.ones((3, 3)), "r1")


def _present(name: str) -> Codec | None:
    """The adapter, or None after checking that its absence is reported."""
    codec = open_codec(name)
    if shutil.which(PROGRAMS[name]):
        return codec
    assert why_not_here(codec) == f"no program '{PROGRAMS[name]}'"
    return None


def _surface() -> np.ndarray:
    rng = np.random.default_rng(3)
    xy = rng.random((3000, 2)) * 1000
    return np.column_stack([xy, 200 + 50 * np.sin(xy[:, 0] / 90)])


def test_dracos_own_encoder_makes_dracopys_bytes_and_keeps_equal_points() -> None:
    tool, ours = _present("draco_cli"), open_codec("draco")
    points = _surface()
    if tool:
        assert encode(tool, points, "r8") == encode(ours, points, "r8")
        twice = np.vstack([points, points])
        assert len(decode(tool, encode(tool, twice, "r8"))) == 6000
        assert codec_of(encode(tool, points, "r8")) == "draco"
    assert len(decode(ours, encode(ours, np.vstack([points, points]), "r8"))) == 3000


@pytest.mark.parametrize("profile", ["minimal", "ctc", "defaults"])
@pytest.mark.parametrize("rounding", ["nearest", "truncate"])
@pytest.mark.parametrize("duplicates", ["merged", "kept"])
def test_the_reference_software_makes_our_streams(
    profile: str, rounding: str, duplicates: str
) -> None:
    changes = {"options": {"profile": profile, "rounding": rounding, "duplicates": duplicates}}
    tool, ours = _present("tmc13"), open_codec("gpcc", changes)
    points = _surface() - 300
    for rate in ("r2", "r3", "r8"):
        stream = encode(ours, points, rate)
        if tool:
            tool = open_codec("tmc13", changes)
            theirs = encode(tool, points, rate)
            assert len(theirs) == len(stream)
            assert theirs[:-8] == stream[:-8]  # the coder's end may hold other bits of no meaning
            decoded = [np.sort(decode(codec, stream), axis=0) for codec in (tool, ours)]
            assert np.array_equal(decoded[0], decoded[1])
        assert len(decode(ours, stream)) <= len(points)


@pytest.mark.parametrize("name", PROGRAMS)
def test_damaged_streams_end_in_one_clean_error_or_points(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("puckbench.codecs.external._SECONDS", 1)
    tool, rng = _present(name), np.random.default_rng(0)
    stream = encode(tool, _surface(), "r1") if tool else b""
    for _ in range(10 if tool else 0):
        damaged = np.frombuffer(stream, np.uint8).copy()
        damaged[rng.integers(0, len(damaged), 3)] = rng.integers(0, 256, 3)
        with suppress(InputError):
            assert tool is not None
            assert np.isfinite(decode(tool, damaged.tobytes())).all()
