"""Runs at budgets of bits: codecs are compared at equal bits, on clouds and on drives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.codecs.coding import decoded
from puckbench.codecs.rates import budgets_of
from puckbench.codecs.registry import entry, open_codec
from puckbench.planning.workflow import Workflow
from puckbench.recordings.drives import Drive, write_drive
from puckbench.results.coded_drives import read_coded_drive
from puckbench.steps.encode_drive import EncodeDrive
from tests.puckbench.codecs.test_budget import turn
from tests.support.in_process import run_in_process

CODECS = ("draco", "puck")
STREET = {"street": {"loader": "street", "options": {"streets": 1}}}
SPIN = {"preset": "spin", "rotation_hz": 10, "frames_per_second": 10, "azimuth_step_deg": 1.6}
TURNS = {
    "scene_set": "street",
    "make": "scan",
    "errors": "vlp16",
    "sweep": {**SPIN, "duration_s": 0.1},
    "size": "metric",
}


def config(tmp_path: Path, **codecs: Any) -> dict[str, Any]:
    return {
        "results": str(tmp_path / "results"),
        "scene_sets": STREET,
        "datasets": {"turns": TURNS},
        "codecs": codecs,
        "timing": {"repeats": 2},
    }


def test_rows_of_a_run_have_equal_bits_and_the_rates_that_were_found(tmp_path: Path) -> None:
    budgets = {"rates": ["12bpp", "24bpp"]}
    metrics, _ = run_in_process(config(tmp_path, draco=budgets, gpcc=budgets, jpegls=budgets))
    rows = metrics.set_index(["codec", "rate"])
    assert sorted(rows.index) == [
        (codec, rate) for codec in ("draco", "gpcc", "jpegls") for rate in ("12bpp", "24bpp")
    ]
    for codec in ("draco", "gpcc"):
        for rate, bpp in (("12bpp", 12.0), ("24bpp", 24.0)):
            row = rows.loc[(codec, rate)]
            assert 0.98 * bpp <= row["bpp"] <= bpp
            assert row["used_rate"].endswith("mm")
            assert row["d1_rms_m"] < float(row["used_rate"][:-2]) / 1000
    finest = rows.loc[("jpegls", "24bpp")]
    assert finest["used_rate"] == "2mm"
    assert "its finest rate, 2mm, takes" in finest["remark"]


def test_a_codec_without_rates_for_the_clouds_does_not_run_at_budgets(tmp_path: Path) -> None:
    plan = Workflow(
        config(tmp_path, draco={"rates": ["9bpp"]}, gpcc_arena={"rates": ["9bpp"]})
    ).plan
    assert plan.codes("draco", "turns")
    assert not plan.codes("gpcc_arena", "turns")  # which has no rates for clouds in metres


def test_a_complete_entry_opens_the_same_codec() -> None:
    changes = {"rates": ["3bpp", "1bpp"], "options": {"profile": "minimal"}}
    complete = entry("gpcc", changes)
    opened, again = open_codec("gpcc", changes), open_codec("gpcc", complete)
    assert budgets_of(again) == budgets_of(opened) == ("1bpp", "3bpp")
    assert again.rates == opened.rates == open_codec("gpcc").rates
    assert entry("gpcc", complete) == complete


def drives(*rates: str, **codecs: Any) -> Workflow:
    way = {**SPIN, "trajectory": [[0, 0, 0, 0, 0, 0, 0], [1, 5, 0, 0, 0, 0, 0]]}
    return Workflow(
        {
            "scene_sets": STREET,
            "datasets": {},
            "drives": {"way": {"scene_set": "street", "sweep": way, "rates": list(rates)}},
            "codecs": codecs or {"draco": {}, "puck": {}, "pcgcv2_plus": {}},
        }
    )


def test_the_streams_of_a_drive_share_a_budget_of_megabits_per_second(tmp_path: Path) -> None:
    flow = drives("2mbps", "1mbps")
    assert flow.drives.entries["way"].rates == dict.fromkeys(CODECS, ("1mbps", "2mbps"))
    steps = [
        flow.step("encode_drive", drives="way", drive="street_1-1", codec=codec).step
        for codec in CODECS
    ]
    file, turns = tmp_path / "drive.zip", (turn(),) * 3
    poses = np.tile(np.eye(4), (2, 1, 1))
    write_drive(file, Drive(turns, np.array([0, 0.1, 0.2]), 0.1, np.array([0, 0.3]), poses))
    for step in steps:
        assert isinstance(step, EncodeDrive)
        step.model_copy(update={"repeats": 1}).run(file, tmp_path / "coded.zip")
        coded = read_coded_drive(tmp_path / "coded.zip")
        assert list(coded) == ["1mbps", "2mbps"]
        codec = step.opened()
        for mbps, (rate, each) in zip((1, 2), coded.items(), strict=True):
            taken = 8e-6 * sum(map(len, each.streams)) / 0.3
            assert taken <= mbps
            if step.codec == "draco":
                assert taken >= 0.98 * mbps
            assert each.record["rate"] == rate
            assert each.record["used_rate"].endswith("mm")
            assert len(decoded(codec, each.streams[2])) > 0


def test_a_drive_has_budgets_or_rates() -> None:
    with pytest.raises(InputError, match="way: budgets such as 1bpp stand alone, without 50mm"):
        drives("1bpp", "50mm")
    entries = drives("50mm", draco={"rates": ["9bpp"]}, pcgcv2_plus={}).drives.entries
    assert entries["way"].rates == {"draco": ("50mm",)}
