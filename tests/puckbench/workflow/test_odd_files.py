"""`puckbench run` on folders where most files are odd: what can be used is, the rest is named."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from puckbench.cli import main
from tests.puckbench.workflow.test_run import run
from tests.support.spinning import pcap, rows, spin

_HEADER = b"ply\nformat binary_little_endian 1.0\nelement vertex %d\n" + b"".join(
    b"property float %c\n" % axis for axis in b"xyz"
)


def _array(points: object) -> Callable[[Path], object]:
    return lambda path: np.save(path, np.asarray(points, dtype=float))


def _bytes(data: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(data)


ODD: dict[str, tuple[Callable[[Path], object], str]] = {
    "cut.ply": (_bytes(_HEADER % 9 + b"end_header\n" + bytes(50)), "not a readable PLY"),
    "empty.xyz": (_bytes(b""), "the cloud is empty"),
    "far.npy": (_array([[0, 0, 0], [1e300, 0, 0]]), "cannot be metres"),
    "flat.obj": (_bytes(b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), "zero area"),
    "gone.npy": (lambda path: path.symlink_to("nowhere.npy"), "no such file"),
    "nan.npy": (_array([[0, 0, np.nan], [1, 1, 1]]), "not finite"),
    "nothing.stl": (_bytes(b"solid nothing\n"), "truncated"),
    "shape.npy": (lambda path: np.save(path, np.zeros((2, 3, 4, 5))), r"\(n, 3\)"),
    "short.pcap": (_bytes(pcap(rows(spin(packets=4)))), "no whole turn"),
    "spot.npy": (_array(np.ones((5, 3))), "no extent"),
    "torn.pcap": (_bytes(b"no capture"), "not a packet capture"),
}
GOOD = {
    "few.npy": _array([[0, 0, 0], [1, 2, 0], [2, 0, 1]]),
    "line.npy": _array(np.outer(np.arange(20), [1, 2, 3])),
    "some.xyz": lambda path: np.savetxt(path, np.random.default_rng(0).random((80, 3))),
}


def _written(folder: Path) -> Path:
    """A folder of ten odd files and few others."""
    folder.mkdir()
    for name, write in {**GOOD, **{name: write for name, (write, _) in ODD.items()}}.items():
        write(folder / name)
    (folder / "again.npy").symlink_to("few.npy")
    return folder


def test_a_folder_of_odd_files_ends_in_a_table_a_report_and_what_was_left_out(
    tmp_path: Path,
) -> None:
    _written(tmp_path / "odd")
    (tmp_path / "notes.md").write_text("Notes.\n")
    words = ["odd", "notes.md", "none.ply", "--codecs", "draco", "--rates", "r3", "r6"]
    done = run(tmp_path, *words)
    assert done.returncode == 0, done.stderr[-4000:]
    whys = {f"odd/{name}": why for name, (_, why) in ODD.items()}
    whys |= {"notes.md": "no cloud, mesh or recording", "none.ply": "no such file"}
    whys["unit of clouds"] = "none in .npy, .ply, .xyz: all clouds are scaled to [0, 1023]"
    lines = done.stdout.splitlines()
    assert lines[1].split()[:3] == ["Clouds", "Draco", str(len(GOOD))]
    output = [line for line in lines if line.startswith("left out: ")]
    assert len(output) == len(whys)
    report = (tmp_path / "out" / "report.html").read_text()
    table = pd.read_csv(tmp_path / "out" / "tables" / "left_out.csv").set_index("file")["reason"]
    assert set(table.index) == set(whys)
    for file, why in whys.items():
        (line,) = [line for line in output if line.startswith(f"left out: {file}: ")]
        assert why.replace("\\", "") in line
        assert table[file] in line
        assert file in report
    metrics = pd.read_csv(tmp_path / "out" / "tables" / "metrics.csv")
    assert set(metrics["cloud"]) == {Path(name).stem for name in GOOD}
    assert len(metrics) == 2 * len(GOOD)

    again = run(tmp_path, *words, "--json")
    assert again.returncode == 0
    answer = json.loads(again.stdout)
    assert {row["file"]: row["why"] for row in answer["left_out"]} == table.to_dict()
    assert [row["clouds"] for row in answer["results"]] == [len(GOOD)]


@pytest.mark.parametrize("strict", [False, True])
def test_a_folder_of_bad_files_alone_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], strict: bool
) -> None:
    folder = _written(tmp_path / "odd")
    for name in GOOD if not strict else ():
        (folder / name).unlink()
    words = [str(folder), "--codecs", "draco", "--out", str(tmp_path / "out")]
    assert main(["run", *words, *(["--strict"] if strict else [])]) == 2
    lines = capsys.readouterr().err.splitlines()
    (line,) = [line for line in lines if "looked at" not in line and "links to" not in line]
    assert line.startswith("puckbench: datasets.clouds: scene ")
    assert "more that cannot be used" in line
    assert not (tmp_path / "out" / "config.yaml").exists()
