"""What a command says when it is interrupted, cannot be what was meant, or has a near name."""

from __future__ import annotations

import json
import platform
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import puckbench
from cloud_files.clouds import read_cloud, write_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from puckbench.cli.answers import text_of
from puckbench.codecs import learned
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.registry import codec_of, open_codec
from puckbench.steps import process
from tests.support.codecs import encode

CAPTURE = Path(__file__).parents[2] / "data" / "capture" / "single.pcap"
OWN = """
import numpy as np
from puckbench.codecs.base import Codec, PointCloud


class Own(Codec):
    rates = {"r1": {}}

    def encode(self, cloud, rate):
        return b"own" + cloud.xyz.tobytes()

    def decode(self, stream):
        return PointCloud(np.frombuffer(stream[3:]).reshape(-1, 3))
"""


@pytest.fixture
def cloud(tmp_path: Path) -> Path:
    points = np.random.default_rng(0).random((500, 3)) * 1023
    write_cloud(tmp_path / "cloud.ply", PointCloud(points, about={"size": 1024}))
    return tmp_path / "cloud.ply"


def _refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert main([*map(str, words)]) == 2
    return capsys.readouterr().err


def test_an_interrupt_is_one_line_and_leaves_nothing(
    cloud: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("puckbench.cli.encode.write_json", interrupted)
    monkeypatch.setattr("puckbench.steps.encode.write_curve", interrupted)
    out = cloud.with_suffix(".bin")
    before = sorted(cloud.parent.iterdir())
    coding = ["--codec", "draco", "--rate", "r1"]
    assert main(["encode", str(cloud), str(out), *coding]) == 130
    assert capsys.readouterr().err == "puckbench: interrupted\n"
    assert sorted(cloud.parent.iterdir()) == before
    words = ["encode", '{"codec": "draco"}', f"cloud={cloud}", f"curve={out}"]
    assert process.main(words) == 130
    assert capsys.readouterr().err == "puckbench: interrupted\n"


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["encode", "{cloud}", "o", "--codec", "dracco", "--rate", "r1"], "draco"),
        (["encode", "{cloud}", "o", "--codec", "draco", "--rate", "r11"], "r1"),
        (["encode", "{cloud}", "o", "--codec", "draco", "--rate", "r1",
          "--entry", '{"optoins": {}}'], "options"),
        (["encode", "{cloud}", "o", "--codec", "draco", "--rate", "r1",
          "--entry", '{"options": {"compression_levl": 3}}'], "compression_level"),
        (["encode", "{cloud}", "o", "--codec", "pcgcv2_plus", "--rate", "r1",
          "--weights", "pcgcv2_room"], "pcgcv2_rooms"),
        (["scan", "{cloud}", "o.parquet", "--sensor", "vlp61"], "vlp16"),
        (["scan", "{cloud}", "o.parquet", "--sweep", "thesi"], "thesis"),
        (["scene", "embedded_rooms", "ofice_1", "o.ply"], "office_1"),
        (["data", "capturd_rooms"], "captured_rooms"),
    ],
)  # fmt: skip
def test_an_unknown_name_is_answered_with_a_near_one(
    words: list[str], meant: str, cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [word.replace("{cloud}", str(cloud)) for word in words]
    assert f"did you mean '{meant}'?" in _refused(capsys, *arguments)


def test_an_unknown_command_is_answered_with_a_near_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["prepar", "x"]) == 2
    assert "did you mean 'prepare'?" in capsys.readouterr().err


def test_a_bare_stream_is_told_its_codec(cloud: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stream = encode(open_codec("gpcc", {"options": {"raw": True}}), read_cloud(cloud).xyz, "r4")
    bare = cloud.with_suffix(".raw")
    bare.write_bytes(stream)
    assert "bare one of G-PCC: name the codec (--codec gpcc)" in _refused(
        capsys, "decode", bare, cloud.with_name("back.ply")
    )
    with pytest.raises(InputError, match="name its codec"):
        codec_of(b"something else")


def test_a_codec_of_one_s_own_file_is_named_again_to_decode(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (cloud.parent / "own.py").write_text(OWN)
    name, stream = f"{cloud.parent}/own.py:Own", cloud.with_suffix(".bin")
    assert main(["encode", str(cloud), str(stream), "--codec", name, "--rate", "r1"]) == 0
    back = cloud.with_name("back.ply")
    assert f"name its code with --codec '{name}'" in _refused(capsys, "decode", stream, back)
    assert main(["decode", str(stream), str(back), "--codec", name]) == 0
    assert np.array_equal(read_cloud(back).xyz, read_cloud(cloud).xyz)
    assert main(["evaluate", str(cloud), str(stream), "--json", "--codec", name]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["codec"] == name


@pytest.mark.parametrize(
    ("name", "said"),
    [("x" * 300, f"{'x' * 300}: file name too long"), ("a\udcff", r"'a\udcff': not in UTF-8")],
)
@pytest.mark.parametrize("words", [["prepare", "o.ply"], ["run"], ["capture", "o.parquet"]])
def test_a_name_that_no_file_can_have_is_one_line(
    words: list[str], name: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _refused(capsys, words[0], name, *words[1:]).startswith(f"puckbench: {said}")


def test_a_recording_is_no_scan(cloud: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = cloud.with_name("returns.parquet")
    assert main(["capture", str(CAPTURE), str(table)]) == 0
    fault = _refused(capsys, "prepare", table, cloud.with_name("ready.ply"))
    assert "a recording's table, not a scan's: export it as a cloud first" in fault


def test_a_prepared_cloud_is_prepared_again_from_metres(cloud: Path) -> None:
    once, twice = cloud.with_name("once.ply"), cloud.with_name("twice.ply")
    metres = cloud.with_name("metres.ply")
    write_cloud(metres, PointCloud(read_cloud(cloud).xyz / 100), describe=False)
    assert main(["prepare", str(metres), str(once)]) == 0
    assert main(["prepare", str(once), str(twice), "--scale", "512"]) == 0
    first, second = read_cloud(once), read_cloud(twice)
    assert second.about["scale"] == pytest.approx(first.about["scale"] * 511 / 1023)
    step_m = 2.0**-16 / second.about["scale"]
    moved = np.abs(second.to_metres(second.xyz) - first.to_metres(first.xyz))
    assert moved.max() < 0.51 * step_m


def test_a_wheel_s_user_is_told_what_pip_installs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        learned, "find_spec", lambda name: None if name == "torch" else find_spec(name)
    )
    why = why_not_here(open_codec("pcgcv2_plus"))
    assert "PyTorch not installed: pip install 'puckbench[learned]'" in why


def test_the_version_is_one_line_and_tells_the_rest_when_asked(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--version"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line == f"puckbench {puckbench.__version__}"
    for words in (["--version", "--verbose"], ["--version", "-v"]):
        assert main(words) == 0
        output = dict(row.split(None, 1) for row in capsys.readouterr().out.splitlines())
        assert output["puckbench"] == puckbench.__version__
        assert output["numpy"] == np.__version__
        assert output["python"].startswith(platform.python_version())
        assert {"commit", "system", "threads", "snakemake", "numba", "compiled"} <= output.keys()


def test_answers_are_lines_and_tables(capsys: pytest.CaptureFixture[str]) -> None:
    answer = {
        "points": 3,
        "size_m": [1.5, 2.0],
        "about": {"a": 1, "b": None},
        "kinds": [{"kind": "plane", "true": 2}, {"kind": "cone", "found": 0.123456789}],
        "none": [],
    }
    assert text_of(answer).splitlines() == [
        "points  3",
        "size_m  1.5, 2",
        "about   a 1, b -",
        "kinds",
        "  kind    true   found",
        "  ───────────────────────",
        "  plane   2",
        "  cone           0.123457",
        "none    none",
    ]


def test_what_prepare_prints_has_no_nested_records(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["prepare", str(cloud), str(cloud.with_name("ready.ply"))]) == 0
    output = capsys.readouterr().out
    assert "points" in output
    assert "{" not in output


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--metres-per-unit", "0"), "must be greater than 0"),
        (("--errors", "vlp16"), "--errors: only with --scan"),
    ],
)
def test_no_option_of_a_run_is_left_aside_in_silence(
    words: tuple[str, ...], told: str, cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told in _refused(capsys, "run", cloud, "--out", cloud.parent / "out", *words)
    assert not (cloud.parent / "out" / "config.yaml").exists()


def test_a_ply_is_not_written_under_the_name_of_another_format(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = cloud.with_suffix(".xyz")
    assert "only PLY files are written" in _refused(capsys, "prepare", cloud, other)
    assert not other.exists()


def test_what_is_missing_and_what_is_no_cloud_is_named_once(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script, mesh = cloud.with_suffix(".py"), cloud.with_suffix(".obj")
    script.write_text("import this")
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    out, missing = cloud.with_name("out.ply"), cloud.with_name("missing")
    assert _refused(capsys, "prepare", script, out).count(str(script)) == 1
    assert "not a point cloud by its name" in _refused(capsys, "prepare", mesh, out)
    assert "no such file" in _refused(capsys, "compare", missing, "--with", "default")
    assert "no such file" in _refused(capsys, "compress", missing, out)


def test_points_that_are_not_finite_are_left_out_when_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = np.random.default_rng(0).random((500, 3))
    points[3], points[7, 1] = np.nan, np.inf
    np.save(tmp_path / "a.npy", points)
    words = ["prepare", tmp_path / "a.npy", tmp_path / "cloud.ply"]
    assert "2 of 500 points are not finite" in _refused(capsys, *words)
    assert main([*map(str, words), "--drop-invalid"]) == 0
    assert len(read_cloud(tmp_path / "cloud.ply")) == 498


@pytest.mark.parametrize(
    "words",
    [
        ["table", "summary", "{folder}/o.csv", "--inputs"],
        ["figure", "fig_6_6", "{folder}/o.png", "--inputs"],
        ["report", "{folder}/o.html", "--contents"],
    ],
    ids=lambda words: words[0],
)
def test_tables_that_do_not_fit_are_one_line(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.csv").write_text("a\n1\n")
    inputs = json.dumps({"metrics": f"{tmp_path}/a.csv"})
    arguments = [word.replace("{folder}", str(tmp_path)) for word in words]
    error = _refused(capsys, *arguments, inputs)
    assert error.count("\n") == 1
    assert not list(tmp_path.glob("o.*"))
