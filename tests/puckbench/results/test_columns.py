"""Every column of a default run is described, once, and a user's columns are shown as they are."""

from __future__ import annotations

from dataclasses import replace
from inspect import signature
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.cloud_metrics import attribute_metrics, geometry_metrics, picture_metrics
from puckbench.metrics.metric_registry import METRICS
from puckbench.metrics.segmentation import WAYS
from puckbench.metrics.sensor_metrics import range_errors_of_points
from puckbench.metrics.task_registry import TASKS
from puckbench.report.reference_results import OF_DRIVES, read_reference, shipped_studies
from puckbench.results.columns import (
    HIGHER,
    LOWER,
    OTHER,
    TASK,
    Column,
    column_named,
    declare,
    declared_columns,
    is_declared,
)
from puckbench.tables.registry import TABLES, table_entries
from tests.support.declared_columns import undeclared
from tests.support.figures_lookalike import recovery_table
from tests.support.reference_lookalike import rows_of


def _tables_of(study: str) -> dict[str, pd.DataFrame]:
    """The tables of a study by name: those that are shipped, and ours that are made of them."""
    results = read_reference(study)
    attributes = {"bpp_geometry": 2.0, "bpp_reflectance": 1.0, "reflectance_psnr": 30.0}
    segmented: dict[str, Any] = {"segmentation_classes": "road"}
    for way in WAYS:
        segmented |= {f"segmentation_{way}miou_percent": 50.0}
        segmented |= {f"segmentation_{way}confusion": "[[3,1]]"}
    made = {
        "metrics": results.metrics.assign(**attributes, **segmented),
        "clouds": results.table("clouds"),
        "scan_errors": results.table("scan_errors"),
        "drives": pd.read_parquet(OF_DRIVES / "drives.parquet"),
        "recovery": recovery_table(),
    }
    for name, entry in table_entries().items():
        is_ours = TABLES.module_of(name).startswith("puckbench.")
        if is_ours and not entry.gathered and name != "published":  # of no data set here
            inputs = {each: made[each] for each in (*entry.inputs, *entry.optional)}
            has_anchor = "anchor" in signature(entry.make).parameters
            made[name] = entry.make(**inputs, **({"anchor": "gpcc"} if has_anchor else {}))
    return made


def test_every_column_of_a_run_is_declared() -> None:
    tables = _tables_of("evidence")
    assert {"against_octree", "noise_bits", "nearest_truth", "odometry_bits"} <= tables.keys()
    assert undeclared(tables.values()) == set()
    assert undeclared(read_reference(name).metrics for name in shipped_studies()) == set()


def test_undeclared_columns_would_be_found() -> None:
    table = pd.DataFrame({"bpp": [1.0], "bpp_q25": [0.5], "of_ones_own_m": [2.0]})
    assert undeclared([table]) == {"of_ones_own_m"}


def test_directions_are_those_in_which_values_move_with_noise() -> None:
    rng = np.random.default_rng(0)
    xyz = rng.uniform(1, 50, (600, 3))
    normals = rng.normal(size=(600, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    colours = rng.integers(0, 255, (600, 3), dtype=np.uint8)
    about = {"scale": 10.0}
    original = PointCloud(xyz, normals=normals, colours=colours, about=about)

    def measured(noise: float) -> dict[str, float]:
        random = np.random.default_rng(1)
        moved = xyz + noise * random.normal(size=xyz.shape)
        changed = np.clip(colours + 40 * noise * random.normal(size=xyz.shape), 0, 255)
        decoded = PointCloud(moved, colours=changed.astype(np.uint8), about=about)
        errors = geometry_metrics(original, moved, peak=100.0)
        values = {**errors, **picture_metrics(original, decoded, 48)}
        values |= attribute_metrics(original, decoded, errors)
        return values | range_errors_of_points(xyz, moved)

    little, much = measured(0.02), measured(0.8)
    better = {name: column_named(name).better for name in little}
    assert {name for name in better if better[name] == HIGHER} == {
        *("d1_psnr", "d2_psnr", "cd_psnr_point", "cd_psnr_plane", "view_psnr", "view_ssim"),
        *("y_psnr", "u_psnr", "v_psnr"),
    }
    assert {"cd_plane", "q99_point_m", "hausdorff_sq_point", "d1_rms_m", "range_rms_mm"} < {
        name for name in better if better[name] == LOWER
    }
    for name, direction in better.items():
        if direction is not None and little[name] != much[name]:
            assert (little[name] > much[name]) == (direction == HIGHER), name


def test_decibels_are_better_high_and_distances_low() -> None:
    for each in declared_columns().values():
        if each.unit == "dB":
            assert each.better == HIGHER, each.name
        if "distance" in each.words.lower() and each.unit.startswith("grid units"):
            assert each.better == (None if each.name == "diameter" else LOWER), each.name
        if each.timed and each.unit:
            assert each.better == LOWER, each.name


def test_a_column_nobody_declared_has_its_name_as_words_and_the_unit_of_its_ending() -> None:
    for name, words, unit in (
        ("tilt_angle_deg", "Tilt angle", "°"),
        ("moved", "Moved", ""),
        ("own_psnr", "Own psnr", "dB"),
    ):
        described = column_named(name)
        assert not is_declared(name)
        assert (described.words, described.unit, described.group) == (words, unit, OTHER)
    assert column_named("tilt_angle_q75_deg").label == "Tilt angle, 75 % (°)"


def test_a_plugin_declares_its_columns_in_words_or_in_full() -> None:
    sway = Column("test_sway_mm", "Sway", "mm", LOWER, missing="it stands still")
    METRICS.register("test_sway", columns=[sway])(lambda *_: {})
    TASKS.register("test_lap", columns={"test_lap_s": "Time of a lap"})(lambda *_: {})
    assert column_named("test_sway_mm") == sway
    assert column_named("test_sway_low_mm", ["test_sway_mm"]).words == "Sway, interval from"
    lap = column_named("test_lap_s")
    assert (lap.words, lap.unit, lap.group) == ("Time of a lap", "s", TASK)


def test_no_column_is_described_twice() -> None:
    with pytest.raises(InputError, match="column 'cd_plane' is declared twice, differently"):
        METRICS.register("test_clash", columns={"cd_plane": "Mine"})(lambda *_: {})
    known = column_named("cd_plane")
    declare([known])
    with pytest.raises(InputError, match="'cd_plane' is declared twice"):
        declare([replace(known, better=HIGHER)])
    assert column_named("cd_plane") == known


def test_a_plugin_s_column_may_be_among_the_medians_of_the_summary() -> None:
    declare([Column("test_moved_m", "Displacement", "m", LOWER, summarised=True)])
    metrics = rows_of("mine", 1.0).assign(test_moved_m=0.1, test_kept_m=0.2)
    table = TABLES.get("summary").make(metrics=metrics)
    assert set(table["test_moved_m"]) == {0.1}
    assert "test_kept_m" not in table
