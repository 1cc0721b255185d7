"""A plan with a job of every kind, and the jobs of a plan by name.

``python -m tests.support.every_job CONFIG < EDITS`` prints, for each edit of a file, the jobs whose
settings or fingerprints it changes.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import yaml

from puckbench.planning.workflow import Workflow
from puckbench.steps.step import PlannedStep
from tests.support import bench

SOURCES = Path(str(sys.modules["puckbench"].__file__)).parents[1]
_SPIN = {"preset": "spin", "azimuth_step_deg": 2.0}

CONFIG: dict[str, Any] = {
    "seed": 1,
    "thesis": True,
    "scene_sets": {
        **bench.CONFIG["scene_sets"],
        "meshes": {"loader": "mesh_files", "options": {"path": "box.off"}},
        "clouds": {"loader": "point_clouds", "options": {"path": "points.csv"}},
        "turns": {"loader": "recordings", "options": {"path": "box.pcap"}},
        "one_turn": {"loader": "recordings", "options": {"path": "box.pcap"}, "limit": 1},
    },
    "datasets": {
        "sampled": {
            "scene_set": "objects",
            "make": "sample",
            "points": 2000,
            "codecs": [
                *("draco", "gpcc", "gpcc_predictive", "pcgcv1_plus", "pcgcv2_plus"),
                *("sparse_octree_net", "mine"),
            ],
        },
        "noisy": {
            "scene_set": "rooms",
            "make": "scan",
            "errors": "vlp16_divergence",
            "sweep": {"duration_s": 0.02},
            "codecs": ["draco", "primitives"],
        },
        "own": {"scene_set": "meshes", "make": "sample", "points": 500, "codecs": ["draco"]},
        "points": {"scene_set": "clouds", "make": "cloud", "codecs": ["draco"]},
        "spin": {
            "scene_set": "rooms",
            "make": "scan",
            "sweep": _SPIN,
            "size": "metric",
            "codecs": ["puck", "gpcc_angular", "laz", "jpegxl"],
        },
        "recorded": {
            "scene_set": "one_turn",
            "make": "cloud",
            "size": "metric",
            "codecs": ["puck", "packets_xz"],
        },
    },
    "drives": {
        "virtual": {
            "scene_set": "meshes",
            "errors": "vlp16",
            "seeds": [1],
            "sweep": {**_SPIN, "trajectory": "path.csv"},
            "codecs": ["puck"],
            "rates": ["20mm"],
            "tasks": {"registration": {}},
        },
        "real": {
            "scene_set": "turns",
            "make": "cloud",
            "poses": "poses.txt",
            "codecs": ["puck"],
            "rates": ["20mm"],
            "tasks": {"registration": {}},
        },
    },
    "codecs": {
        "draco": {"rates": ["r8"], "metric_rates": []},
        "gpcc": {"rates": ["r2"], "metric_rates": []},
        "gpcc_predictive": {"rates": ["r1"], "metric_rates": []},
        "primitives": {"rates": ["r3"]},
        "pcgcv1_plus": {"rates": ["r1"]},
        "pcgcv2_plus": {"rates": ["r1"]},
        "sparse_octree_net": {"rates": ["r1"]},
        "puck": {"metric_rates": ["20mm"]},
        "gpcc_angular": {"metric_rates": ["20mm"]},
        "laz": {"metric_rates": ["20mm"]},
        "jpegxl": {"metric_rates": ["20mm"]},
        "packets_xz": {},
        "mine": {"class": "mine.py:Mine", "rates": {"r1": {"step": 1.0}}},
    },
    "metrics": ["density"],
    "train": {
        "small": {
            "codec": "pcgcv2_plus",
            "datasets": ["sampled"],
            "validate": ["sampled"],
            "steps": 1,
            "options": {
                "lmbdas": [1, 4],
                "channels": [4, 8, 8, 8],
                "batch_size": 1,
                "cube_size": 1024,
            },
        }
    },
    "train_segmentation": {
        "small": {
            "datasets": ["spin"],
            "validate": ["spin"],
            "steps": 1,
            "options": {"labels": "rooms", "cells": 64, "crop_cells": 32, "channels": [4, 4, 4, 4]},
        }
    },
    "sensor_study": {
        "models": {"vlp16": {}},
        "captures": {"box": {"path": "box.pcap"}},
        "distances_m": [1, 5],
        "runs": 1,
        "rows": 300,
    },
    "figures": {"style": {"dpi": 60}, "examples": {"noisy": "noisy/copy_room_1"}},
    "timing": {"repeats": 1},
}

CODEC = """
import numpy as np
import gpcc
from puckbench.codecs.base import Codec, PointCloud


class Mine(Codec):
    def encode(self, cloud, rate):
        grid = np.round(cloud.xyz / self.rates[rate]["step"]).astype(np.int64)
        return gpcc.encode_geometry(grid)

    def decode(self, stream):
        return PointCloud(gpcc.decode_geometry(stream).positions())
"""


def jobs_of(flow: Workflow) -> dict[str, PlannedStep]:
    """Return the steps of a plan, named after their rule, and what they make."""
    return dict(
        (*_of_clouds(flow), *_of_codecs(flow), *_of_drives(flow), *_of_study(flow), *_outputs(flow))
    )


def _of_clouds(flow: Workflow) -> Iterator[tuple[str, PlannedStep]]:
    plan = flow.plan
    for name, scenes in plan.scene_sets.items():
        for scene in scenes.chosen:
            yield f"scene {name}", flow.step("scene", scene_set=name, scene=scene)
    for dataset, cloud in plan.clouds:
        data, names = plan.datasets[dataset], {"dataset": dataset, "cloud": cloud}
        if (make := data.settings.make) != "cloud":
            yield f"{make} {dataset}", flow.step(make, **names)
        rule = "prepare_returns" if data.has_returns else "prepare"
        yield f"prepare {dataset}", flow.step(rule, **names)


def _of_codecs(flow: Workflow) -> Iterator[tuple[str, PlannedStep]]:
    plan = flow.plan
    for dataset, cloud, codec in plan.curves:
        name = f"{dataset}/{codec}"
        names = {"dataset": dataset, "cloud": cloud, "codec": codec}
        for rule in ("encode", "evaluate", "decode_shown"):
            yield f"{rule} {name}", flow.step(rule, **names)
        rate = plan.rates(codec, plan.datasets[dataset].frame)[0]
        yield f"decode {name}", flow.step("decode", **names, rate=rate)
    for dataset, cloud, codec in plan.recovered:
        step = flow.step("recovery", dataset=dataset, cloud=cloud, codec=codec)
        yield f"recovery {dataset}/{codec}", step
    for dataset, cloud in plan.scanned:
        yield f"scan_error {dataset}", flow.step("scan_error", dataset=dataset, cloud=cloud)
    for name in plan.trainings:
        yield f"train {name}", flow.step("weights", trained=name)
    for name in plan.segmentations:
        yield f"segmentation {name}", flow.step("segmentation_weights", network=name)


def _of_drives(flow: Workflow) -> Iterator[tuple[str, PlannedStep]]:
    for name, entry in flow.drives.entries.items():
        rule = "drive" if entry.settings.is_scan else "drive_of_clouds"
        for drive in entry.drives:
            names = {"drives": name, "drive": drive}
            yield f"drive {name}", flow.step(rule, **names)
            yield f"measure_undecoded {name}", flow.step("measure_undecoded", **names)
            for codec in entry.rates:
                for coding in ("encode_drive", "measure_drive"):
                    yield f"{coding} {name}/{codec}", flow.step(coding, **names, codec=codec)


def _of_study(flow: Workflow) -> Iterator[tuple[str, PlannedStep]]:
    if flow.study is None:
        return
    for model in flow.study.study.models:
        yield f"residuals {model}", flow.step("residuals", model=model)
        yield f"wall_points {model}", flow.step("wall_points", model=model)
    for capture in flow.study.study.captures:
        yield f"capture_residuals {capture}", flow.step("capture_residuals", capture=capture)
    yield "calibration", flow.step("calibration")
    for table in flow.study.gathered:
        yield f"table {table}", flow.step("study_table", table=table)


def _outputs(flow: Workflow) -> Iterator[tuple[str, PlannedStep]]:
    outputs = flow.outputs
    for table in outputs.gathered:
        yield f"table {table}", flow.step("results_table", table=table)
    yield from ((f"table {name}", flow.step("table", table=name)) for name in outputs.tables)
    yield from ((f"figure {name}", flow.step("figure", figure=name)) for name in outputs.figures)
    yield "first_look", flow.step("first_look")
    yield "report", flow.step("report_page")
    yield "reference", flow.step("reference")


def _states(config: str) -> dict[str, list[str]]:
    jobs = jobs_of(Workflow(yaml.safe_load(Path(config).read_text())))
    return {name: [job.settings, job.fingerprint] for name, job in jobs.items()}


def _in_a_fork(config: str) -> dict[str, list[str]]:
    """Return the jobs' settings and fingerprints, which this process does not remember."""
    with get_context("fork").Pool(1) as pool:
        return pool.apply(_states, (config,))


def main() -> None:
    """Print the jobs that each edit (file, old text, new text) changes, as JSON."""
    config, changed = sys.argv[1], []
    before = _in_a_fork(config)
    for name, old, new in json.load(sys.stdin):
        file = Path(name) if Path(name).exists() else SOURCES / name
        content = file.read_bytes()
        assert content.count(old.encode()) == 1, f"{name}: {old}"
        file.write_bytes(content.replace(old.encode(), new.encode()))
        after = _in_a_fork(config)
        file.write_bytes(content)
        changed.append([job for job, state in after.items() if state != before.get(job)])
    json.dump(changed, sys.stdout)


if __name__ == "__main__":
    main()
