"""Clouds that are too wide for a codec's fine rates lose these rates alone, before a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.cli import main
from puckbench.planning.config import checked
from puckbench.planning.plan import Plan
from puckbench.planning.running import left_out_lines
from puckbench.planning.user_files import UserRun
from puckbench.planning.workflow import Workflow

POINTS = np.random.default_rng(0).random((50, 3))
POINTS[:2] = [[0, 0, 0], [1, 1, 1]]
RATES = ("100mm", "10mm", "2mm", "1mm")


@pytest.fixture(autouse=True)
def clouds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Clouds that are 50 m, 5 km and 50 km wide."""
    monkeypatch.chdir(tmp_path)
    for name, width in (("near", 50.0), ("wide", 5000.0), ("wider", 50_000.0)):
        np.save(f"{name}.npy", POINTS * [width, 40, 10])


def configured(*files: str, **asked: Any) -> dict[str, Any]:
    run = UserRun(files, ("gpcc", "draco"), "out", frame="metric", rates=RATES, **asked)
    return run.configuration()


def test_a_wide_cloud_loses_the_rates_that_are_too_fine_for_it() -> None:
    plan = Plan(checked(configured("near.npy", "wide.npy", "wider.npy")), check_scenes=True)
    assert plan.too_wide == {
        ("clouds", "wide", "gpcc"): ("2mm", "1mm"),  # 2^21 steps of 2 mm are 4,194 m
        ("clouds", "wider", "gpcc"): ("10mm", "2mm", "1mm"),
    }
    rates = {
        (cloud, codec): list(plan.curve_rates(dataset, cloud, codec))
        for dataset, cloud, codec in plan.curves
    }
    assert rates["near", "gpcc"] == rates["wider", "draco"] == list(RATES)
    assert rates["wide", "gpcc"] == ["100mm", "10mm"]
    assert rates["wider", "gpcc"] == ["100mm"]


def test_what_is_left_out_is_named_with_its_remedy() -> None:
    plan = Plan(checked(configured("near.npy", "wide.npy")), check_scenes=True)
    (line,) = left_out_lines(plan.left_out_rows())
    assert line == (
        "left out: wide.npy: codec gpcc at 2mm, 1mm: the cloud is 5,000 m wide, more than 4,194 m: "
        "crop it, or take a coarser rate"
    )


def test_jobs_are_planned_for_the_other_cells_alone() -> None:
    config = configured("near.npy", "wide.npy", "wider.npy")
    flow = Workflow(config, check_scenes=True)
    names = ("near", "wide", "wider")
    assert set(flow.plan.rows("metrics")) == {
        f"metrics/clouds/{name}/{codec}.parquet" for name in names for codec in ("gpcc", "draco")
    }
    for name, count in zip(names, (4, 2, 1), strict=True):
        for rule in ("encode", "evaluate"):
            for codec, expected in (("gpcc", RATES[:count]), ("draco", RATES)):
                step = flow.step(rule, dataset="clouds", cloud=name, codec=codec).step
                assert tuple(step.entry["metric_rates"]) == expected


def test_scaled_clouds_are_never_too_wide() -> None:
    run = UserRun(("wider.npy",), ("gpcc",), "out", frame="scaled")
    plan = Plan(checked(run.configuration()), check_scenes=True)
    assert plan.too_wide == {}
    assert plan.left_out_rows() == ()


def test_a_strict_run_stops_at_a_wide_cloud() -> None:
    with pytest.raises(InputError, match=r"^wide\.npy: codec gpcc at 2mm, 1mm: .* crop it"):
        configured("near.npy", "wide.npy", strict=True)


def test_a_codec_that_no_cloud_is_narrow_enough_for_is_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["--frame", "metric", "--codecs", "gpcc", "--rates", "2mm", "1mm"]
    assert main(["run", "wide.npy", *words]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        "puckbench: codec gpcc: every cloud is too wide for its rates: "
        "crop it, or take a coarser rate"
    )


def test_a_codec_that_no_cloud_is_narrow_enough_for_does_not_end_the_run_of_another() -> None:
    options: dict = {"frame": "metric", "rates": ("2mm", "1mm")}
    config = UserRun(("wide.npy",), ("draco", "gpcc"), "out", **options).configuration()
    assert list(config["codecs"]) == ["draco"]
    assert config["unused"]["codec gpcc"].startswith("every cloud is too wide for its rates")


def test_the_extent_of_a_sampled_mesh_is_known_too() -> None:
    Path("plain.obj").write_text("v 0 0 0\nv 9000 0 0\nv 0 9000 0\nf 1 2 3\n")
    plan = Plan(checked(configured("plain.obj", points=200)), check_scenes=True)
    assert plan.too_wide == {("meshes", "plain", "gpcc"): ("2mm", "1mm")}
