"""Shipped configurations for data that puckbench cannot fetch, on trees of their layout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from pointkit.errors import InputError
from puckbench.planning.config import checked
from puckbench.planning.workflow import Workflow
from tests.support import stanford_lookalike as lookalike
from tests.support.files import put

ROOT = Path(__file__).parents[2]
ROOM = ((0.0, 0.0, 0.0), (4.0, 5.0, 3.0))


def read(name: str) -> dict[str, Any]:
    config: dict[str, Any] = yaml.safe_load((ROOT / "config" / name).read_text())
    return config


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """``data`` of the working folder: an airplane of CAPOD and one office in every area."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "data"
    put(folder / "CAPOD" / "CAPOD.cla", "PSB 1\n1 1\n\nAirplane 0 1\n37\n")
    put(folder / "CAPOD" / "class1" / "m37.obj", "v 0 0 0\n")
    for area in ("1", "2", "3", "4", "5a", "5b", "6"):
        number = area[0]
        lookalike.write_mesh(folder, area, [(f"office_1_{number}", ROOM)])
        lookalike.cloud(folder, f"Area_{number}/office_1/office_1.txt", ROOM)
        lookalike.positions(folder, area, {f"office_1_{number}": [2.0, 2.0, 1.3]})
    (folder / "positions").rename(folder / "s3dis_locations")
    return folder


@pytest.mark.parametrize("name", ["thesis.yaml", "capod.yaml"])
def test_a_shipped_configuration_fits_the_schema(name: str) -> None:
    config = checked(read(name))
    assert config.datasets["capod"].points == 500_000


def test_the_thesis_is_planned_in_full(data: Path) -> None:
    plan = Workflow(read("thesis.yaml")).plan
    counts = {name: len(entry.clouds) for name, entry in plan.datasets.items()}
    assert counts == {"capod": 1, "s3dis": 6, "scans_clean": 7, "scans_noisy": 7}
    assert plan.datasets["scans_noisy"].points == 480 * 150 * 16


def test_the_learned_codecs_take_the_authors_weights_by_path(data: Path) -> None:
    weights = data / "elsewhere"
    weights.mkdir(parents=True)
    (weights / "a0.75b3.npz").write_bytes(b"")
    config = read("thesis.yaml")
    config["codecs"]["pcgcv1"] = {"options": {"weights": str(weights)}}
    plan = Workflow(config).plan
    assert {"pcgcv1", "pcgcv1_plus", "pcgcv2_plus"} < set(plan.codecs)
    assert [path.name for path in plan.weights["pcgcv1"]] == ["a0.75b3.npz"]
    assert [path.name for path in plan.weights["pcgcv2_plus"]] == ["pcgcv2_objects.safetensors"]


def test_a_learned_codec_without_weights_is_named_before_anything_runs(data: Path) -> None:
    with pytest.raises(InputError, match=r"codecs.pcgcv1: no weights in data/pcgc_weights: fetch"):
        Workflow({**read("thesis.yaml"), "codecs": {"pcgcv1": {}}})


def test_the_settings_that_the_thesis_ran_are_accepted(data: Path) -> None:
    config = read("thesis.yaml")
    config["datasets"]["scans_noisy"] |= {
        "sweep": "thesis_room",
        "errors": "thesis_room",
        "crop": "noisy",
    }
    plan = Workflow(config).plan
    assert plan.datasets["scans_noisy"].points == 95 * 868 * 16


def test_a_missing_set_is_named_with_its_place(data: Path) -> None:
    (data / "2D-3D-S").rename(data / "elsewhere")
    with pytest.raises(InputError, match=r"^scene_sets\.room_meshes: data/2D-3D-S: no such folder"):
        Workflow(read("thesis.yaml"))


def test_all_objects_of_capod_are_coded_at_all_rates(data: Path) -> None:
    plan = Workflow(read("capod.yaml")).plan
    assert plan.clouds == (("capod", "m037"),)
    rates = {codec: plan.curve_rates("capod", "m037", codec) for codec in plan.codecs}
    assert rates == {name: (*entry["rates"],) for name, entry in plan.codecs.items()}
    assert set(plan.codecs) == {"draco", "gpcc", "gpcc_arena"}


def test_learned_codecs_run_on_one_object_of_each_class_of_capod(data: Path) -> None:
    more = read("capod_learned.yaml")
    chosen = more["scene_sets"]["objects"]["select"]
    assert chosen == [f"m{12 * k + 1:03}" for k in range(15)]  # 15 classes of 12, in their order
    assert read("capod_first.yaml")["scene_sets"]["objects"]["select"] == chosen
    classes = [f"Class{k} 0 1\n{name[1:].lstrip('0')}\n" for k, name in enumerate(chosen)]
    put(data / "CAPOD" / "CAPOD.cla", "PSB 1\n15 15\n\n" + "\n".join(classes))
    for k, name in enumerate(chosen):
        file = data / "CAPOD" / f"class{k + 1}" / f"m{name[1:].lstrip('0')}.obj"
        put(file, "v 0 0 0\n")
    for lmbda in ("0.75", "2", "3.5", "6", "10"):
        put(data / "pcgc_weights" / f"a{lmbda}b3.npz", "")
    for lmbda in ("025", "05", "1", "2", "4", "6", "10"):
        put(data / "pcgc_weights" / f"c8_a{lmbda}_32000.pth", "")
    config = read("capod.yaml")
    config["scene_sets"]["objects"] |= more.pop("scene_sets")["objects"]
    config["codecs"] |= more.pop("codecs")
    plan = Workflow({**config, **more}).plan
    assert len(plan.clouds) == 15
    assert {name: len(codec["rates"]) for name, codec in plan.codecs.items()} == {
        "draco": 8, "gpcc": 8, "gpcc_arena": 8, "pcgcv1": 6, "pcgcv2": 7
    }  # fmt: skip


def test_noise_is_studied_on_the_same_scenes_by_codecs_of_turns() -> None:
    plan = Workflow(read("evidence.yaml")).plan
    turns = [name for name in plan.datasets if name.startswith(("turns", "streets"))]
    models = {plan.datasets[name].settings.errors for name in turns}
    assert models == {"none", "vlp16_measured"}
    for name in turns:
        codecs = {codec for codec in plan.codecs if plan.codes(codec, name)}
        assert codecs >= {"draco", "jpegxl", "gpcc", "gpcc_angular", "gpcc_predictive", "puck"}


def test_turns_in_streets_are_of_several_sensors() -> None:
    plan = Workflow(read("sweeps.yaml")).plan
    sensors = {data.settings.sensor for data in plan.datasets.values()}
    assert sensors == {"vlp16", "hdl32e", "hdl64e_s2", "puck_hires"}


def test_reno_runs_on_sweeps_beside_gpcc_at_the_rates_of_each(data: Path) -> None:
    """The octree's rates have the grids of 2 and 1 mm, with which tables of savings compare."""
    put(data / "reno_weights" / "KITTIDetection.pt", "")
    config, laid_over = read("sweeps.yaml"), read("sweeps_reno.yaml")
    config["codecs"] |= laid_over["codecs"]
    for name, changes in laid_over["datasets"].items():
        config["datasets"][name] |= changes
    plan = Workflow(config).plan
    codecs = plan.codecs
    assert all(plan.codes("reno", name) for name in plan.datasets)
    rates = codecs["reno"]["metric_rates"]
    assert list(rates) == [f"{1 << n}mm" for n in range(9, 1, -1)]
    assert list(codecs["gpcc"]["metric_rates"]) == [f"{mm}mm" for mm in (100, 50, 20, 10, 5, 2, 1)]


def test_the_handicap_is_planned_with_its_table_and_figure(data: Path) -> None:
    put(data / "reno_weights" / "KITTIDetection.pt", "")
    bench = Workflow(read("handicap.yaml"))
    assert "handicap" in bench.outputs.figures
    assert "against_octree" in bench.outputs.tables
    assert all(bench.plan.codes(name, "streets_hdl64e") for name in bench.plan.codecs)
    assert {"gpcc", "gpcc_lossless", "gpcc_no_sensor", "reno"} <= set(bench.plan.codecs)


def test_data_of_the_users_own_are_lines_to_take_the_signs_from() -> None:
    text = (ROOT / "config" / "handicap.yaml").read_text()
    lines = text.replace("\n  # Yours", "\n#").replace("\n  # ", "\n  ").splitlines()
    config = checked(yaml.safe_load("\n".join(lines)))
    loaders = {name: scenes.loader for name, scenes in config.scene_sets.items()}
    assert loaders.pop("streets") == "street"
    assert loaders == {
        "indoors": "recordings", "outdoors": "recordings", "kitti": "kitti", "nuscenes": "nuscenes",
    }  # fmt: skip
    for name in loaders:
        assert config.datasets[name].scene_set == name
        assert config.datasets[name].is_metric


def test_the_thesis_is_planned_at_full_size_without_its_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bench = Workflow({**read("thesis.yaml"), "stand_in": True})
    counts = {name: len(entry.clouds) for name, entry in bench.plan.datasets.items()}
    assert counts == {"capod": 180, "s3dis": 272, "scans_clean": 272, "scans_noisy": 272}
    points = {name: entry.points for name, entry in bench.plan.datasets.items()}
    assert points["capod"] == 500_000
    assert points["scans_clean"] == points["scans_noisy"] == 1_152_000
    assert {f"fig_6_{number}" for number in range(1, 10)} <= set(bench.outputs.figures)
    assert not any(
        plan.files(scene) for plan in bench.plan.scene_sets.values() for scene in plan.chosen[:3]
    )
    assert bench.config.results == "results/thesis_stand_in"
    assert (
        2 * len(bench.plan.curves) < 11_000
    )  # coding and measuring: with scenes, scans and clouds below 14,000
