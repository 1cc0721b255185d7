"""What a calibration's model file says, and how residual tables are read by default."""

from __future__ import annotations

from pathlib import Path

import pytest

from pointkit.errors import InputError
from puckbench.steps.calibration import Calibrate


def test_without_a_recording_there_is_nothing_to_calibrate_to(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no recording to calibrate to \(sensor_study: captures"):
        Calibrate().run(tmp_path / "model.yaml")
