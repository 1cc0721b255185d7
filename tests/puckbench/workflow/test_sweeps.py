"""A run of spins and recordings: clouds in metres with returns, beside scaled ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from tests.support.bench import Bench

SPIN = {"preset": "spin", "azimuth_step_deg": 1.0}
CHANGES: dict[str, Any] = {
    "datasets": {
        "raw": {"scene_set": "rooms", "make": "sample", "points": 2000},
        "spin": {"scene_set": "rooms", "make": "scan", "sweep": SPIN, "size": "metric"},
        "spin_noisy": {
            "scene_set": "rooms",
            "make": "scan",
            "sweep": SPIN,
            "errors": "vlp16",
            "size": "metric",
        },
        "real": {"scene_set": "tape", "make": "cloud", "size": "metric", "codecs": ["puck"]},
    },
    "codecs": {
        "draco": {"rates": ["r1", "r8"], "metric_rates": ["50mm", "2mm"]},
        "gpcc": {"rates": ["r1", "r8"], "metric_rates": ["50mm", "10mm", "2mm"]},
        "gpcc_angular": {"rates": ["r1", "r8"], "metric_rates": ["50mm", "10mm", "2mm"]},
        "puck": {},
    },
    "sensor_study": False,
    "figures": {"style": {"dpi": 60}, "examples": {"spin": "spin_noisy/copy_room_1"}},
}


def _changes(recording: str) -> dict[str, Any]:
    tape = {"loader": "recordings", "options": {"path": recording}}
    return {**CHANGES, "scene_sets.tape": tape}


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    bench = Bench(tmp_path_factory.mktemp("sweeps"))
    recording = bench.capture()
    bench.configure(
        {**CHANGES, "scene_sets.tape": {"loader": "recordings", "options": {"path": recording}}}
    )
    bench.made()
    return bench


def test_every_cloud_is_coded_in_its_frame(bench: Bench) -> None:
    rows = pd.read_parquet(bench.results / "tables" / "metrics.parquet")
    result = {
        (dataset, codec): list(part["rate"])
        for (dataset, codec), part in rows.groupby(["dataset", "codec"], sort=False)
    }
    lengths = ["100mm", "50mm", "20mm", "10mm", "4mm", "2mm"]
    assert result == {
        ("raw", "draco"): ["r1", "r8"],
        ("raw", "gpcc"): ["r1", "r8"],
        ("raw", "gpcc_angular"): ["r1", "r8"],
        ("spin", "draco"): ["50mm", "2mm"],
        ("spin", "gpcc"): ["50mm", "10mm", "2mm"],
        ("spin", "gpcc_angular"): ["50mm", "10mm", "2mm"],
        ("spin", "puck"): lengths,
        ("spin_noisy", "draco"): ["50mm", "2mm"],
        ("spin_noisy", "gpcc"): ["50mm", "10mm", "2mm"],
        ("spin_noisy", "gpcc_angular"): ["50mm", "10mm", "2mm"],
        ("spin_noisy", "puck"): lengths,
        ("real", "puck"): lengths,
    }
    exact = rows[(rows["codec"] == "puck") & (rows["rate"] == "2mm")]
    assert (exact["d1_mse"] == 0).all()
    assert (exact[["range_max_mm", "returns_lost", "returns_added"]] == 0).all(axis=None)
    assert (exact["mbit_per_s"] > 0).all()


def test_noise_is_in_the_distance_to_the_truth_and_in_the_bits(bench: Bench) -> None:
    rows = pd.read_parquet(bench.results / "tables" / "metrics.parquet")
    finest = rows[(rows["codec"] == "puck") & (rows["rate"] == "2mm")].set_index("dataset")
    assert finest.loc["spin", "truth_d2_rms_m"] < 0.001  # half of a quantum
    assert 0.005 < finest.loc["spin_noisy", "truth_d2_rms_m"] < 0.05
    assert pd.isna(finest.loc["real", "truth_d2_rms_m"])
    clouds = pd.read_parquet(bench.results / "tables" / "clouds.parquet").set_index("dataset")
    assert clouds.loc["spin_noisy", "noise_bits"] > 4 > clouds.loc["spin", "noise_bits"] == 0
    assert finest.loc["spin_noisy", "bpp"] > finest.loc["spin", "bpp"] + 2


def test_figures_and_tables_of_spins_are_made(bench: Bench) -> None:
    drawn = {path.stem for path in (bench.results / "figures").glob("*.png")}
    assert {"sweeps_rd", "sweeps_truth", "noise_cost", "spin_images", "fig_6_6"} <= drawn
    assert "sweeps_ranges" in drawn
    table = pd.read_csv(bench.results / "tables" / "storage.csv")
    assert set(table["dataset"]) == {"spin", "spin_noisy", "real"}
    assert set(table["kept"]) == {"exact", "less"}
    assert {"d2_rms_mm", "truth_d2_rms_mm", "returns_added", "encode_ms_per_turn"} < set(table)
    cost = pd.read_csv(bench.results / "tables" / "noise_bits.csv").set_index(["codec", "dataset"])
    assert cost.loc[("puck", "spin_noisy"), "added_grid_1_mm"] > 2
    assert pd.isna(cost.loc[("draco", "spin_noisy"), "grid_1_mm"])  # 2 mm at most
    assert bench.planned() == {}


def test_bits_are_compared_with_the_octrees(bench: Bench) -> None:
    assert (bench.results / "figures" / "handicap.png").exists()
    table = pd.read_csv(bench.results / "tables" / "against_octree.csv")
    noisy = table[table["dataset"] == "spin_noisy"].set_index("codec")
    assert set(noisy.index) == {"draco", "gpcc", "gpcc_angular", "puck"}
    assert noisy.loc["gpcc", "saved_at_10_mm"] == noisy.loc["gpcc", "saved_grid_2_mm"] == 0
    assert noisy.loc["gpcc_angular", "saved_grid_2_mm"] > 10
    assert noisy.loc["puck", "saved_grid_2_mm"] > 40
    assert noisy["grid_1_mm"].drop("puck").isna().all()


def test_a_changed_length_re_runs_its_codecs_curves_of_spins_alone(bench: Bench) -> None:
    bench.configure(_changes("box.pcap") | {"codecs.draco.metric_rates": ["100mm", "2mm"]})
    planned = bench.planned("tables")
    assert planned["encode_draco"] == planned["evaluate_draco"] == 2
    assert not {"encode_puck", "scan", "prepare_returns"} & planned.keys()


def test_a_recording_must_be_there(bench: Bench, tmp_path: Path) -> None:
    other = Bench(tmp_path)
    other.configure(
        {**CHANGES, "scene_sets.tape": {"loader": "recordings", "options": {"path": "no.pcap"}}}
    )
    done = other.snakemake("--dry-run")
    assert done.returncode == 2
    assert "no.pcap: no such file or folder" in done.stderr
