"""The numbers of the page on odometry are those of the shipped results."""

import pytest

from puckbench.io.tables import read_table
from puckbench.metrics.tables.odometry_bits import odometry_bits
from puckbench.report.reference_results import OF_DRIVES
from tests.support.bench import ROOT

PAGE = (ROOT / "docs" / "explanation" / "odometry.md").read_text(encoding="utf-8")
NAMES = {"straight, errors `vlp16`": "straight_vlp16", "turning": "turning", "stop": "stop_and_go"}


@pytest.mark.parametrize(("begins", "dataset"), NAMES.items())
def test_bits_that_odometry_needs_are_those_of_the_study(begins: str, dataset: str) -> None:
    bits = odometry_bits(read_table(OF_DRIVES / "drives.parquet"))
    rows = bits[(bits["dataset"] == dataset) & (bits["measure"] == "drift_percent")]
    (line,) = [line for line in PAGE.splitlines() if line.startswith(f"| {begins}")]
    for row in rows.itertuples():
        assert f"{row.bits:.2f} ({row.rate.replace('mm', ' mm')})" in line
        assert f"{row.undecoded:.2f} %" in line


def test_drift_of_each_error_model_is_that_of_the_study() -> None:
    drives = read_table(OF_DRIVES / "drives.parquet")
    straight = drives[drives["dataset"].str.startswith("straight")]
    for (model, codec, rate), rows in straight.groupby(["error_model", "codec", "rate"]):
        if rate == "times" or (codec == "puck" and rate in ("200mm", "500mm")):
            lines = [line for line in PAGE.splitlines() if line.startswith(f"| `{model}`")]
            assert f"{rows['drift_percent'].mean():.2f} %" in lines[0], (model, codec, rate)
