"""The commands compress and decompress, and commands that read what they wrote."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from puck import compress
from puckbench.cli import main
from puckbench.recordings.reading import read_packets
from puckbench.scene_sets.recordings import decompressed
from tests.support.cloud_bags import cloud_bag
from tests.support.spinning import pcap, rows, spin


def recorded() -> list[bytes]:
    return rows(spin(packets=50))


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = pcap(recorded())
    (tmp_path / "a.pcap").write_bytes(data)
    names = [str(tmp_path / name) for name in ("a.pcap", "a.puck", "b.pcap")]
    assert main(["compress", *names[:2], "--effort", "fast", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["packets"] == 50
    assert answer["compressed_bytes"] == (tmp_path / "a.puck").stat().st_size
    assert main(["decompress", *names[1:], "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == answer
    assert (tmp_path / "b.pcap").read_bytes() == data


def test_a_compressed_recording_within_another_is_not_read(tmp_path: Path) -> None:
    """Each layer would multiply what the file unpacks to."""
    (tmp_path / "a.pcap").write_bytes(pcap(recorded()))
    compress(tmp_path / "a.pcap", tmp_path / "b.puck")
    with decompressed(tmp_path / "b.puck") as whole:
        assert len(read_packets(whole)) == 50
    compress(tmp_path / "b.puck", tmp_path / "c.puck")
    with (
        pytest.raises(InputError, match=r"c\.puck: a compressed recording within another"),
        decompressed(tmp_path / "c.puck"),
    ):
        pass


def test_clouds_that_lzma_compresses_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of noise that comes again after another message, LZMA takes half of the bytes."""
    random = np.random.default_rng(0)
    kind = [(name, "<f4") for name in "xyz"]
    one, other = (np.frombuffer(random.bytes(12 * 500), kind) for _ in range(2))
    path = cloud_bag(tmp_path / "a.bag", {"/points": [one, other] * 2})
    names = [str(tmp_path / name) for name in ("a.bag", "a.puck", "b.bag")]
    assert main(["compress", *names[:2], "--json"]) == 0
    out, error = capsys.readouterr()
    assert json.loads(out)["clouds"] == 0
    told = "LZMA alone compresses 4 PointCloud2 messages, as models would take more bytes"
    assert f"{path}: {told}" in error
    assert main(["decompress", *names[1:]]) == 0
    assert (tmp_path / "b.bag").read_bytes() == path.read_bytes()
