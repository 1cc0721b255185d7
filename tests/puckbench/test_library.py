"""The names that `import puckbench` offers."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import puckbench
from puck import compress
from puckbench.cli import main
from puckbench.metrics.pcqm import pcqm
from puckbench.tables.rate_deltas import bd_rate_clouds
from tests.support import cloud_turns
from tests.support.cloud_bags import cloud_bag
from tests.support.codecs import decode_cloud, encode, encode_cloud
from tests.support.pages import blocks
from tests.support.spinning import VLP16, pcap, spin

PAGE = "docs/how-to/use_as_a_library.md"


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    path = tmp_path / "turns.pcap"
    path.write_bytes(pcap([bytes(packet) for packet in spin(VLP16, packets=300)]))
    return path


def test_a_capture_goes_turn_by_turn_through_a_codec_and_back(capture: Path) -> None:
    puck = puckbench.open_codec("puck")
    turns = list(puckbench.turns(capture))
    assert len(turns) >= 2
    for turn in turns:
        stream = puckbench.encoded(puck, turn, "2mm")
        decoded = puckbench.decoded(puck, stream)
        np.testing.assert_array_equal(decoded.xyz, turn.xyz)
        metrics = puckbench.measures(turn, decoded)
        assert metrics["range_rms_mm"] == metrics["returns_lost"] == metrics["d1_mse"] == 0
        assert metrics["lossless"] == 1


def test_the_loop_of_the_page_prints_bits_and_errors(
    capture: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(capture.parent)
    capture.rename("recording.pcap")
    (code,) = (block for block in blocks(PAGE, "python") if "puckbench.turns" in block)
    exec(code, {})  # noqa: S102 (our own page)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 2
    assert all(float(line.split()[0]) > 0 and float(line.split()[1]) == 0 for line in lines)


def test_turns_of_a_bag_of_clouds_are_the_messages_of_a_topic(tmp_path: Path) -> None:
    clouds = []
    for number in range(3):
        rows = np.zeros(4, [(axis, "<f4") for axis in "xyz"])
        rows["x"] = np.arange(4) + number + 1
        clouds.append(rows)
    bag = cloud_bag(tmp_path / "a.mcap", {"/front": clouds, "/rear": clouds[:1]})
    turns = list(puckbench.turns(bag, topic="/front"))
    assert [turn.xyz[:, 0].tolist() for turn in turns] == [c["x"].tolist() for c in clouds]
    compress(bag, tmp_path / "small.puck")
    same = list(puckbench.turns(tmp_path / "small.puck", topic="/front"))
    assert all((one.xyz == other.xyz).all() for one, other in zip(turns, same, strict=True))
    for path in (bag, tmp_path / "small.puck"):
        with pytest.raises(puckbench.InputError, match=f"{path}: .*several topics"):
            next(puckbench.turns(path))


def test_clouds_of_a_compressed_bag_are_exported(tmp_path: Path) -> None:
    bag = cloud_bag(tmp_path / "a.bag", {"/points": cloud_turns.turns(3)})
    compress(bag, tmp_path / "a.puck")
    for source in (bag, tmp_path / "a.puck"):
        out = tmp_path / f"{source.suffix}.csv"
        assert main(["export", str(source), str(out), "--turns", "1-2"]) == 0
    assert (tmp_path / ".bag.csv").read_bytes() == (tmp_path / ".puck.csv").read_bytes()


def test_metrics_of_points_need_no_returns(capture: Path) -> None:
    turn = next(puckbench.turns(capture))
    moved = puckbench.PointCloud(turn.xyz + np.array([0.01, 0, 0]))
    metrics = puckbench.measures(turn, moved)
    assert 0 < metrics["d1_rms_m"] <= 0.01
    assert "range_rms_mm" not in metrics


def test_importing_the_package_imports_nothing_heavy() -> None:
    program = "import sys, puckbench; print(*puckbench.__all__); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    names, modules = map(str.split, done.stdout.splitlines())
    assert {"open_codec", "read_cloud", "turns", "measures"} <= set(names)
    assert not {"numpy", "pandas", "pydantic"} & set(modules)


POINTS = np.random.default_rng(1).random((200, 3)) * 10
CLOUD = puckbench.PointCloud(POINTS)
ANY: Any = puckbench
"""The package without its types, for arguments that they forbid."""


def test_points_are_prepared_like_a_cloud_of_them() -> None:
    prepared = puckbench.prepare(POINTS, size=np.int64(64))
    assert prepared.about == puckbench.prepare(CLOUD, size=64).about
    assert prepared.about["size"] == 64


def _draco(**changes: Any) -> puckbench.library.Codec:
    return puckbench.open_codec("draco", {"rates": ["r1"], **changes})


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "prepare_list": (
        lambda: ANY.prepare([[1, 2, 3]]),
        "expected a PointCloud or points .n, 3., not l",
    ),
    "prepare_path": (
        lambda: ANY.prepare("a.ply"),
        "expected a PointCloud or points .n, 3., not str",
    ),
    "prepare_flat": (lambda: puckbench.prepare(POINTS[0]), r"of shape \(n, 3\), got \(3,\)"),
    "prepare_none": (lambda: puckbench.prepare(POINTS[:0]), "the cloud is empty"),
    "prepare_one": (lambda: puckbench.prepare(POINTS[:1]), "no extent"),
    "prepare_small": (lambda: puckbench.prepare(CLOUD, 1), "size is 1, but must be greater than"),
    "prepare_below_0": (lambda: puckbench.prepare(CLOUD, -4), "size is -4, but must be greater"),
    "prepare_half": (lambda: ANY.prepare(CLOUD, 10.5), "size is 10.5, but must be"),
    "prepare_word": (lambda: puckbench.prepare(CLOUD, "big"), "size is 'big', but must be"),
    "prepare_few": (lambda: puckbench.prepare(CLOUD, 64, 0), "neighbours is 0, but must be"),
    "compare_name": (lambda: ANY.compare(CLOUD, ["draco"]), "'draco' is not a codec"),
    "compare_words": (lambda: ANY.compare(CLOUD, "draco"), "'d' is not a codec"),
    "compare_file": (lambda: ANY.compare("a.ply", [_draco()]), "not str"),
    "compare_0": (lambda: puckbench.compare(CLOUD, [_draco()], 0), "repeats is 0, but must"),
    "compare_peak": (lambda: ANY.compare(CLOUD, [_draco()], 1, "a"), "peak is 'a', but must"),
    "measures_peak": (lambda: puckbench.measures(CLOUD, CLOUD, -1), "peak is -1.0, but must"),
    "measures_nan": (lambda: puckbench.measures(CLOUD, CLOUD, np.nan), "peak is nan, but must"),
    "measures_name": (
        lambda: puckbench.measures(CLOUD, CLOUD, metrics=["pcqn"]),
        "unknown metric 'pcqn' .*did you mean 'pcqm'",
    ),
    "measures_bytes": (lambda: ANY.measures(CLOUD, b"stream"), "not bytes"),
    "codec_none": (lambda: ANY.open_codec(None), "a codec's name is a string, not NoneType"),
    "codec_path": (lambda: ANY.open_codec(Path("a.py")), "a codec's name is a string, not"),
    "changes_list": (lambda: ANY.open_codec("draco", ["r1"]), "must be a mapping"),
    "changes_key": (lambda: _draco(rate=["r1"]), "unknown option 'rate' .*did you mean 'rates'"),
    "changes_rates": (lambda: _draco(rates="r1"), "rates is 'r1', but must be a list"),
    "changes_options": (lambda: _draco(options=None), "options is None, but must be"),
    "encode_array": (
        lambda: encode_cloud(ANY_CODEC, POINTS, "r1"),
        "a PointCloud is coded, not nd",
    ),
    "encode_name": (lambda: ANY.encoded("draco", POINTS, "1mm"), "'draco' is not a codec"),
    "encode_list": (lambda: ANY.encoded(ANY_CODEC, [[1, 2, 3]], "r1"), "not list"),
    "encode_frame": (lambda: puckbench.encoded(GPCC, POINTS, "r1"), "does not say whether it is s"),
    "decode_name": (lambda: ANY.decoded("draco", b""), "'draco' is not a codec"),
    "rates_dict": (lambda: ANY.bd_rate({}, CURVE), "anchor: expected rows of the .* not dict"),
    "rates_names": (
        lambda: puckbench.bd_rate(CURVE, CURVE, "d1_psrn"),
        "anchor: no column 'd1_psrn'; did you mean 'd1_psnr'",
    ),
    "rates_codecs": (
        lambda: puckbench.bd_rate(CURVE, pd.concat([CURVE, CURVE.assign(codec="b")])),
        "tested: rows of 2 codecs: select those of one",
    ),
    "rates_text": (
        lambda: puckbench.bd_rate(CURVE, CURVE.assign(bpp="1")),
        "tested: column 'bpp' is not numbers",
    ),
    "rates_few": (
        lambda: puckbench.bd_rate(CURVE, CURVE[1:]),
        "too few points .4 points of the anchor, 3 points of the tested codec; shared range 0%.",
    ),
    "rates_apart": (
        lambda: puckbench.bd_rate(CURVE, CURVE.assign(d1_psnr=CURVE["d1_psnr"] + 20)),
        "overlap below half .* shared range 33%.* half of the shorter range",
    ),
    "rates_zero": (
        lambda: puckbench.bd_rate(CURVE, CURVE.assign(bpp=[0.0, 1.0, 2.0, 3.0])),
        "'bpp' must be positive, but is not for tested of r1",
    ),
    "rates_peaks": (
        lambda: puckbench.bd_rate(CURVE.assign(peak=1023.0), CURVE.assign(peak=30.0)),
        "have the peaks 30 and 1023",
    ),
    "rates_exact": (
        lambda: puckbench.bd_rate(CURVE, CURVE.assign(lossless=True)),
        "too few points .4 points of the anchor, 0 points of the tested codec",
    ),
    "encode_rate": (lambda: encode_cloud(ANY_CODEC, CLOUD, 1), "a rate is a name, not int"),
    "decode_none": (lambda: decode_cloud(ANY_CODEC, None), "a stream is bytes, not NoneType"),
    "decode_cloud": (lambda: decode_cloud(ANY_CODEC, CLOUD), "a stream is bytes, not PointCloud"),
    "decode_returns": (
        lambda: decode_cloud(ANY.open_codec("puck"), "text"),
        "codec puck: a stream is bytes, not str",
    ),
    "no_recording": (lambda: list(puckbench.turns("")), "0 ROS bags"),
}
ANY_CODEC: Any = _draco()
GPCC = puckbench.open_codec("gpcc")
CURVE = pd.DataFrame(
    {
        "codec": "a",
        "rate": ["r1", "r2", "r3", "r4"],
        "bpp": [1.0, 2.0, 4.0, 8.0],
        "d1_psnr": [40.0, 50.0, 60.0, 70.0],
    }
)


@pytest.mark.parametrize("case", REFUSED)
def test_other_arguments_are_refused_in_a_line(case: str) -> None:
    call, fault = REFUSED[case]
    with pytest.raises(puckbench.InputError, match=fault) as refusal:
        call()
    assert "\n" not in str(refusal.value)


def test_a_cloud_in_metres_is_not_coded_on_the_grid_of_scaled_ones() -> None:
    codec = puckbench.open_codec("gpcc")
    with pytest.raises(puckbench.InputError, match="does not say whether it is scaled: prepare it"):
        encode_cloud(codec, CLOUD, "r3")
    with pytest.raises(puckbench.InputError, match="is in metres: prepare it"):
        encode_cloud(codec, puckbench.prepare(CLOUD, 0), "r3")
    prepared = puckbench.prepare(CLOUD)
    with pytest.raises(puckbench.InputError, match="are lengths, and the cloud is scaled"):
        encode_cloud(codec, prepared, "10mm")
    assert encode_cloud(codec, prepared, "r3") == encode(codec, prepared.xyz, "r3")
    assert encode_cloud(codec, CLOUD, "10mm") == encode(codec, POINTS, "10mm")
    said = puckbench.PointCloud(prepared.xyz, about={"size": 1024})
    assert encode_cloud(codec, said, "r3") == encode(codec, prepared.xyz, "r3")


def test_a_curve_is_read_by_a_name_of_its_file(tmp_path: Path) -> None:
    with pytest.raises(puckbench.InputError, match="no such file"):
        puckbench.library.read_curve(str(tmp_path / "none.zip"))
    assert len(puckbench.compare(puckbench.prepare(CLOUD), [_draco()])) == 1


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.25])
def test_a_constant_factor_of_the_bits_is_the_bd_rate(factor: float) -> None:
    tested = CURVE.assign(codec="b", bpp=factor * CURVE["bpp"])
    assert puckbench.bd_rate(CURVE, tested) == pytest.approx(100 * (factor - 1))
    there = puckbench.bd_rate(tested, CURVE)
    assert there == pytest.approx(100 * (1 / factor - 1))


def test_other_qualities_are_converted_to_decibels() -> None:
    """Errors of 10^(-q/20) m and squared errors of 10^(-q/10) have the qualities q."""
    tested = CURVE.assign(codec="b", bpp=0.5 * CURVE["bpp"])
    for name, divisor in (("d1_rms_m", 20), ("d1_mse", 10)):
        rows = [
            each.assign(**{name: 10 ** (-each["d1_psnr"] / divisor)}) for each in (CURVE, tested)
        ]
        assert puckbench.bd_rate(*rows, name) == pytest.approx(-50)


def test_the_bd_rate_of_two_codecs_is_that_of_the_table() -> None:
    codecs = [puckbench.open_codec("draco"), GPCC]
    table = puckbench.compare(puckbench.prepare(POINTS), codecs)
    curves = [table[table["codec"] == name] for name in ("draco", "gpcc")]
    rows = bd_rate_clouds(table.assign(dataset="d", cloud="c"), "draco", ["d1_psnr", "d1_mse"])
    for quality, expected in zip(rows["metric"], rows["bd_rate_percent"], strict=True):
        assert puckbench.bd_rate(*curves, quality) == pytest.approx(expected)
    assert len(rows) == 2


def test_points_are_taken_as_a_cloud_of_them() -> None:
    assert puckbench.encoded(GPCC, POINTS, "10mm") == puckbench.encoded(GPCC, CLOUD, "10mm")
    assert puckbench.measures(POINTS, POINTS + 0.5) == puckbench.measures(
        CLOUD, puckbench.PointCloud(POINTS + 0.5)
    )
    arrays, clouds = (
        puckbench.compare(each, [puckbench.open_codec("draco", {"metric_rates": ["10mm"]})])
        for each in (POINTS, CLOUD)
    )
    assert arrays[["rate", "bpp", "d1_mse"]].equals(clouds[["rate", "bpp", "d1_mse"]])


NOT_FINITE = np.where(np.arange(600).reshape(200, 3) == 7, np.nan, POINTS)
SAME_LINE: dict[str, tuple[Callable[[], Any], Any, list[str]]] = {
    "not_finite": (lambda: puckbench.prepare(NOT_FINITE), NOT_FINITE, ["prepare", "IN", "a.ply"]),
    "flat": (lambda: puckbench.prepare(POINTS[:, :2]), POINTS[:, :2], ["prepare", "IN", "a.ply"]),
    "empty": (lambda: puckbench.prepare(POINTS[:0]), POINTS[:0], ["prepare", "IN", "a.ply"]),
    "words": (
        lambda: puckbench.prepare(POINTS.astype(str)),
        POINTS.astype(str),
        ["prepare", "IN", "a.ply"],
    ),
    "one_point": (lambda: puckbench.prepare(POINTS[:1]), POINTS[:1], ["prepare", "IN", "a.ply"]),
    "size": (
        lambda: puckbench.prepare(POINTS, 1),
        POINTS,
        ["prepare", "IN", "a.ply", "--scale", "1"],
    ),
    "peak": (
        lambda: puckbench.measures(POINTS, POINTS, -1),
        POINTS,
        ["evaluate", "IN", "IN", "--peak", "-1"],
    ),
    "peak_nan": (
        lambda: puckbench.measures(POINTS, POINTS, np.nan),
        POINTS,
        ["evaluate", "IN", "IN", "--peak", "nan"],
    ),
    "codec": (
        lambda: puckbench.open_codec("drako"),
        POINTS,
        ["encode", "IN", "a.bin", "--codec", "drako", "--rate", "r1"],
    ),
    "rate": (
        lambda: puckbench.encoded(GPCC, POINTS, "r99"),
        POINTS,
        ["encode", "IN", "a.bin", "--codec", "gpcc", "--rate", "r99"],
    ),
    "frame": (
        lambda: puckbench.encoded(GPCC, POINTS, "r1"),
        POINTS,
        ["encode", "IN", "a.bin", "--codec", "gpcc", "--rate", "r1"],
    ),
}
"""Wrong calls, the array they have, and the commands that read it from a file instead."""
_BEGINS = re.compile(r"^(?:(?:in.npy|prepare|evaluate|measures|the cloud|--rate): )*")
_ENDS = " (prepare and run leave them out: --drop-invalid)"


@pytest.mark.parametrize("case", SAME_LINE)
def test_the_library_refuses_as_the_command_line_does(
    case: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    call, array, words = SAME_LINE[case]
    monkeypatch.chdir(tmp_path)
    np.save("in.npy", array)
    assert main(["in.npy" if word == "IN" else word for word in words]) == 2
    printed = capsys.readouterr().err.removeprefix("puckbench: ").strip().removesuffix(_ENDS)
    with pytest.raises(puckbench.InputError) as refusal:
        call()
    said, shown = (_BEGINS.sub("", line) for line in (str(refusal.value), printed))
    assert said == shown
    assert [path.name for path in tmp_path.iterdir()] == ["in.npy"]


def test_the_bd_rate_of_the_page_is_that_of_its_codecs() -> None:
    code = next(block for block in blocks(PAGE, "python") if "puckbench.bd_rate" in block)
    table = pd.concat(
        [CURVE.assign(codec="draco"), CURVE.assign(codec="grid", bpp=CURVE["bpp"] / 4)]
    )
    first, second = code.strip().splitlines()
    names = {"table": table, "puckbench": puckbench}
    exec(first, names)  # noqa: S102 (our own page)
    assert eval(second, names) == pytest.approx(-75)  # noqa: S307


def test_further_metrics_are_measured_by_name() -> None:
    colours = np.random.default_rng(2).integers(0, 256, POINTS.shape).astype(np.uint8)
    grey = np.full_like(colours, 127)
    clouds = [puckbench.PointCloud(POINTS, colours=each) for each in (colours, grey)]
    assert puckbench.measures(*clouds, metrics=["pcqm"])["pcqm"] == pcqm(*clouds) > 0
    assert "pcqm" not in puckbench.measures(*clouds)
