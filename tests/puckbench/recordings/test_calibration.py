from pathlib import Path

import pandas as pd
import pytest

from pointkit.tables import write_table
from puckbench.cli import main
from tests.support.calibration_lookalike import residuals
from virtual_lidar import open_error_model
from virtual_lidar.calibration.likelihood import Sigmas

EVERY_KIND = Sigmas(0.008, 0.004, 0.003, 0.006, 0.002, 0.0003)


def table_of(sigmas: Sigmas, seed: int, frames: int = 6) -> pd.DataFrame:
    ray = sigmas.ray
    biases = (sigmas.laser_sigma_m, sigmas.scan_sigma_m, sigmas.frame_sigma_m)
    laser, scan, frame = biases
    return residuals(seed, laser=laser, scan=scan, frame=frame, ray=ray, frames=frames)


def test_the_command_writes_a_model_that_draws_what_was_hidden(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_table(table_of(EVERY_KIND, 11), tmp_path / "r.parquet")
    assert main(["calibrate", str(tmp_path / "r.parquet"), str(tmp_path / "m.yaml")]) == 0
    assert "laser_sigma_m" in capsys.readouterr().out
    model = vars(open_error_model("calibrated", {"file": str(tmp_path / "m.yaml")}))
    for name, value in vars(EVERY_KIND).items():
        assert model[name] == pytest.approx(value, rel=0.5, abs=4e-4)
    assert len(model["bias_m"]) == 16


@pytest.mark.parametrize(
    ("words", "fault"),
    [([], "choose one"), (["--model", "vlp16"], "no row of the model 'vlp16'")],
)
def test_a_table_of_several_models_asks_for_one(
    words: list[str], fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    two = pd.concat([residuals(15), residuals(15).assign(model="other")], ignore_index=True)
    write_table(two, tmp_path / "r.parquet")
    assert main(["calibrate", str(tmp_path / "r.parquet"), str(tmp_path / "m.yaml"), *words]) == 2
    error = capsys.readouterr().err
    assert fault in error
    assert error.count("\n") == 1
    assert not (tmp_path / "m.yaml").exists()
