"""`puckbench compare`: one's own codec beside reference results, on the same clouds alone."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pointkit.errors import InputError
from puckbench.cli import main
from puckbench.report.reference_results import check_results, read_reference, write_reference
from tests.support.reference_lookalike import (
    CLOUDS,
    GPCC,
    MINE,
    PEAK,
    rows_of,
    write_run,
    write_study,
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_study(tmp_path_factory.mktemp("study") / "known.parquet"))


@pytest.fixture
def mine() -> pd.DataFrame:
    return rows_of("mine", MINE)


def compare(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    """Exit status, and what is printed."""
    status = main(["compare", *map(str, words)])
    shown = capsys.readouterr()
    return status, shown.out, shown.err


def test_deltas_are_the_known_ratios(
    study: str, mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_run(tmp_path, mine)
    status, out, _ = compare(capsys, folder, "--with", study, "--json")
    assert status == 0
    answer = json.loads(out)
    result = {(row["anchor"], row["metric"]): row for row in answer["deltas"]}
    for metric in ("d1_psnr", "d2_psnr"):
        for anchor, bits in (("draco", 1.0), ("gpcc", GPCC)):
            row = result[anchor, metric]
            assert row["bd_rate_percent"] == pytest.approx(100 * (MINE / bits - 1), abs=1e-3)
            assert row["bd_rate_percent_low"] is None  # of four scenes
            assert (row["codec"], row["clouds"], row["compared"]) == ("mine", 4, 4)
            assert (row["scenes"], row["verdict"]) == (4, "no verdict")
    names = [Path(file).name for file in answer["files"]]
    assert names == ["known.png", "known.pdf", "known.svg", "known.csv"]
    picture = np.asarray(Image.open(answer["files"][0]).convert("RGB")).astype(int)
    coloured = np.ptp(picture, axis=2) > 60
    assert coloured.sum() > 1000
    for colour in ((0x00, 0x72, 0xB2), (0xE6, 0x9F, 0x00)):  # of Draco and G-PCC, on white
        pale = (np.array(colour) + 255) / 2
        assert (np.abs(picture - pale).max(axis=2) < 6).sum() > 200


def test_clouds_of_one_scene_count_once(
    mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The study says which clouds share a scene, the run does not."""
    scenes = {"scene": lambda rows: rows["cloud"].str[-1].astype(int) // 2}
    study = write_study(tmp_path / "seeds.parquet", **scenes)
    _, out, _ = compare(capsys, write_run(tmp_path, mine), "--with", study, "--json")
    assert [(row["clouds"], row["scenes"]) for row in json.loads(out)["deltas"]] == [(4, 2)] * 4


def test_the_table_has_the_run_s_codec_before_theirs(
    study: str, mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_run(tmp_path, mine)
    _, out, _ = compare(capsys, folder, "--with", study)
    lines = out.replace("\N{NO-BREAK SPACE}", " ").splitlines()
    assert lines[0].startswith("Things, 4 clouds")
    assert [line.split("  ")[0] for line in lines[1:4]] == ["mine", "Draco, known", "G-PCC, known"]
    assert [*filter(None, lines[5].split("  "))] == ["bits at equal quality", "D1", "D2"]
    value = "−50.0 % (−50.0 % to −50.0 %, 4 scenes, no verdict)"
    assert re.split("  +", lines[6]) == ["mine against Draco", value, value]
    assert lines[7].startswith("mine against G-PCC")
    assert any(line.startswith("A against B: by how much A needs more (+)") for line in lines)


def test_a_study_without_times_is_not_timed(
    mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    original = read_reference(str(write_study(tmp_path / "known.parquet")))
    rows = original.metrics.drop(columns=["digest", "encode_s", "decode_s"])
    about = {**original.about, "not_timed": "the machine was busy"}
    write_reference(tmp_path / "slow.parquet", rows, about)
    folder = write_run(tmp_path, mine)
    _, out, _ = compare(capsys, folder, "--with", tmp_path / "slow.parquet")
    heads, own, draco, *_ = out.splitlines()
    ends = heads.index("s, at most") + len("s, at most")
    assert [line[:ends].split("  ")[-1].strip() for line in (own, draco)] == ["0.15", "not timed"]
    assert "slow is not timed: the machine was busy." in out
    _, out, _ = compare(capsys, folder, "--with", tmp_path / "slow.parquet", "--json")
    assert json.loads(out)["not_timed"] == "the machine was busy"
    _, out, _ = compare(capsys, folder, "--with", tmp_path / "known.parquet")
    assert "not timed" not in out


def test_other_points_are_refused_and_named(
    study: str, mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    digests = {**CLOUDS, ("objects", "thing_1"): "f" * 32}
    folder = write_run(tmp_path, mine, digests)
    status, out, err = compare(capsys, folder, "--with", study)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert "objects/thing_1 (other points)" in err
    assert "--common compares the other 3" in err
    assert not (folder / "comparison").exists()
    status, out, _ = compare(capsys, folder, "--with", study, "--common", "--json")
    assert status == 0
    answer = json.loads(out)
    assert answer["left_out"] == ["objects/thing_1 (other points)"]
    assert {row["clouds"] for row in answer["deltas"]} == {3}


def test_clouds_are_known_by_their_digests_whatever_their_names(
    study: str, mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    renamed = mine.assign(dataset="here", cloud="my_" + mine["cloud"])
    digests = {("here", f"my_{cloud}"): digest for (_, cloud), digest in CLOUDS.items()}
    folder = write_run(tmp_path, renamed, digests)
    status, out, _ = compare(capsys, folder, "--with", study, "--json")
    assert status == 0
    assert {row["dataset"] for row in json.loads(out)["deltas"]} == {"objects"}


def test_a_codec_of_both_is_compared_when_it_is_named_and_its_bytes_are_checked(
    study: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = rows_of("gpcc", GPCC)
    again.loc[0, "bytes"] += 1
    folder = write_run(tmp_path, pd.concat([again, rows_of("mine", MINE)]))
    _, out, _ = compare(capsys, folder, "--with", study, "--json")
    answer = json.loads(out)
    assert answer["codecs"] == ["mine"]
    assert answer["same_streams"] == {"gpcc": [19, 20]}
    _, out, _ = compare(capsys, folder, "--with", study, "--codecs", "gpcc", "--json")
    deltas = {row["anchor"]: row["bd_rate_percent"] for row in json.loads(out)["deltas"]}
    assert deltas["gpcc"] == pytest.approx(0, abs=1e-3)
    assert deltas["draco"] == pytest.approx(-20, abs=1e-3)


@pytest.mark.parametrize(
    ("change", "words", "message"),
    [
        (lambda t: t.drop(index=7), [], "no result of objects/thing_1 at r3"),
        (lambda t: t[t["rate"] == "r1"], [], "only the rate r1 on objects"),
        (lambda t: t.drop(columns="d2_psnr"), [], "the run has no metric 'd2_psnr'"),
        (lambda t: t, ["--metrics", "colour"], "the run has no metric 'colour'"),
        (lambda t: t.assign(d1_psnr=t["d1_psnr"].mask(t.index == 2)), [], "no d1_psnr of objects"),
        (lambda t: t, ["--codecs", "mime"], "no codec 'mime'"),
        (lambda t: t[t["cloud"] == "none"], [], "the table has no rows"),
    ],
)
def test_what_is_missing_is_told_in_one_line(
    study: str,
    mine: pd.DataFrame,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: object,
    words: list[str],
    message: str,
) -> None:
    folder = write_run(tmp_path, change(mine))  # type: ignore[operator]
    status, _, err = compare(capsys, folder, "--with", study, *words)
    assert status == 2
    assert message in err
    assert err.count("\n") == 1


def test_a_lossless_rate_has_no_psnr(
    study: str, mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    exact = mine["rate"] == "r5"
    kept = mine.assign(
        d1_mse=mine["d1_mse"].mask(exact, 0.0),
        d2_mse=mine["d1_mse"].mask(exact, 0.0),
        d1_psnr=mine["d1_psnr"].mask(exact),
        d2_psnr=mine["d2_psnr"].mask(exact),
    )
    folder = write_run(tmp_path, kept)
    status, out, _ = compare(capsys, folder, "--with", study, "--json")
    assert status == 0
    answer = json.loads(out)
    assert answer["deltas"][0]["bd_rate_percent"] == pytest.approx(-50, abs=1e-3)
    assert (answer["deltas"][0]["lossless"], answer["deltas"][0]["anchor_lossless"]) == (4, 0)
    _, out, _ = compare(capsys, folder, "--with", study)
    assert "Lossless rates, which have no PSNR and are in no BD-rate: mine r5 (4 clouds)." in out


def test_psnrs_of_another_peak_are_refused(
    study: str, mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The study's own rows name no peak: it follows from their errors and PSNRs."""
    folder = write_run(tmp_path / "same", mine.assign(peak=PEAK))
    status, out, _ = compare(capsys, folder, "--with", study)
    assert status == 0
    assert "PSNRs D1 and D2: peak 1023." in out
    other = mine.assign(peak=2 * PEAK, d1_psnr=mine["d1_psnr"] + 20 * np.log10(2))
    folder = write_run(tmp_path / "other", other)
    status, out, err = compare(capsys, folder, "--with", study)
    assert (status, out) == (2, "")
    assert "PSNRs of objects/thing_0 have the peaks 1023 and 2046" in err
    assert err.count("\n") == 1
    status, _, _ = compare(capsys, folder, "--with", study, "--metrics", "d1_mse")
    assert status == 0


def test_tables_without_digests_are_of_an_older_run(
    study: str, mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_run(tmp_path, mine)
    clouds = folder / "tables" / "clouds.parquet"
    pd.read_parquet(clouds).drop(columns="digest").to_parquet(clouds)
    status, _, err = compare(capsys, folder, "--with", study)
    assert (status, "of an older run" in err) == (2, True)


def test_an_unknown_study_and_other_files_are_refused(
    mine: pd.DataFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_run(tmp_path, mine)
    status, _, err = compare(capsys, folder, "--with", "kapod")
    assert (status, "no reference results 'kapod'" in err) == (2, True)
    table = folder / "tables" / "metrics.parquet"
    status, _, err = compare(capsys, folder, "--with", table)
    assert (status, "not a file of reference results" in err) == (2, True)


@pytest.mark.parametrize("values", [[[1, 2]], [{"a": 1}], [pd.Timestamp(0)], None], ids=str)
@pytest.mark.parametrize(
    "column", ["dataset", "cloud", "codec", "rate", "bytes", "bpp", "d1_psnr", "d1_mse", "encode_s"]
)
def test_columns_of_other_kinds_are_named(
    column: str, values: list[object] | None, mine: pd.DataFrame
) -> None:
    check_results(mine)
    others = mine.drop(columns=column)
    if values is not None:
        others = mine.assign(**{column: values * len(mine)})
    elif column not in ("dataset", "cloud", "codec", "rate", "bytes", "bpp"):
        check_results(others)
        return
    with pytest.raises(InputError, match=f"^(no )?column '{column}'( is not (text|numbers))?$"):
        check_results(others)


@pytest.mark.parametrize("table", ["metrics", "clouds"])
@pytest.mark.parametrize("rows", [{"dataset": [[1]]}, {}, {"dataset": ["a"]}], ids=str)
def test_tables_of_other_things_are_one_line(
    rows: dict[str, list[object]],
    table: str,
    study: str,
    mine: pd.DataFrame,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = write_run(tmp_path, mine)
    pd.DataFrame(rows, index=[0]).to_parquet(folder / "tables" / f"{table}.parquet")
    status, _, error = compare(capsys, folder, "--with", study)
    assert (status, error.count("\n")) == (2, 1)
    assert error.startswith(f"puckbench: {folder}")


@pytest.mark.parametrize("metrics", [["dataset"], ["bpp"], ["peak"], ["codec_version"]])
def test_what_is_no_metric_is_one_line(
    metrics: list[str],
    study: str,
    mine: pd.DataFrame,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = write_run(tmp_path, mine)
    status, _, error = compare(capsys, folder, "--with", study, "--metrics", *metrics)
    assert (status, error.count("\n")) == (2, 1)
    assert f"the run has no metric '{metrics[0]}' on these clouds" in error
