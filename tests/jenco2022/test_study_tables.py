"""Points of a wall and `puckbench table`: what they write, and bad input in one line."""

from pathlib import Path

import pandas as pd
import pytest

from jenco2022.steps.wall_points import WallPoints
from pointkit.errors import InputError
from puckbench.cli import main


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    assert main([str(word) for word in words]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("puckbench: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_a_table_without_inputs_is_written_in_both_forms(tmp_path: Path) -> None:
    files = [tmp_path / "t.csv", tmp_path / "t.parquet"]
    assert main(["table", "table_4_2", *map(str, files)]) == 0
    table = pd.read_csv(files[0], keep_default_na=False)
    pd.testing.assert_frame_equal(table, pd.read_parquet(files[1]))
    assert len(table) == 16


def test_a_scan_s_points_and_their_effect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # the working folder may hold the results of a run
    scan = tmp_path / "scan.parquet"
    WallPoints(distances_m=(1.0,), rows=2000).run(scan)
    points = pd.read_parquet(scan)
    assert points["surface"].value_counts().tolist() == [2000] * 3
    residuals = points.assign(run=1, residual_m=points["y_m"])[points["surface"] == "wall"]
    residuals.to_csv(tmp_path / "residuals.csv", index=False)
    inputs = f'{{"scans": "{scan}", "residuals": "{tmp_path}/residuals.csv"}}'
    out = tmp_path / "effect.csv"
    assert main(["table", "incidence_effect", str(out), "--inputs", inputs]) == 0
    effect = pd.read_csv(out)
    ratio = effect["surface_distance_std_m"] / effect["predicted_std_m"]
    assert ratio.tolist() == pytest.approx([1] * len(effect), rel=0.1)
    capsys.readouterr()
    assert "needs the input 'residuals'" in refused(capsys, "table", "thesis_numbers", out)
    with pytest.raises(InputError, match="wall_floor_7m"):
        WallPoints(distances_m=(7.0,)).run(scan)
