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

from puckbench.planning.planned_job import PlannedJob
from puckbench.planning.workflow import Workflow
from tests.support import bench

SOURCES = Path(str(sys.modules["puckbench"].__file__)).parents[1]
_SPIN = {"preset": "spin", "azimuth_step_deg": 2.0}

CONFIG: dict[str, Any] = {
    "seed": 1,
    "scenes": {
        **bench.CONFIG["scenes"],
        "meshes": {"loader": "mesh_files", "options": {"path": "box.off"}},
        "clouds": {"loader": "point_clouds", "options": {"path": "points.csv"}},
        "turns": {"loader": "recordings", "options": {"path": "box.pcap"}},
        "one_turn": {"loader": "recordings", "options": {"path": "box.pcap"}, "limit": 1},
    },
    "datasets": {
        "sampled": {
            "scenes": "objects",
            "make": "sample",
            "points": 2000,
            "codecs": [
                *("draco", "gpcc", "gpcc_predictive", "pcgcv1_plus", "pcgcv2_plus"),
                *("sparse_octree_net", "mine"),
            ],
        },
        "noisy": {
            "scenes": "rooms",
            "make": "scan",
            "errors": "vlp16_divergence",
            "sweep": {"duration_s": 0.02},
            "codecs": ["draco", "primitives"],
        },
        "own": {"scenes": "meshes", "make": "sample", "points": 500, "codecs": ["draco"]},
        "points": {"scenes": "clouds", "make": "cloud", "codecs": ["draco"]},
        "spin": {
            "scenes": "rooms",
            "make": "scan",
            "sweep": _SPIN,
            "size": "metric",
            "codecs": ["puck", "gpcc_angular", "laz", "jpegxl"],
        },
        "recorded": {
            "scenes": "one_turn",
            "make": "cloud",
            "size": "metric",
            "codecs": ["puck", "packets_xz"],
        },
    },
    "drives": {
        "virtual": {
            "scenes": "meshes",
            "errors": "vlp16",
            "seeds": [1],
            "sweep": {**_SPIN, "trajectory": "path.csv"},
            "codecs": ["puck"],
            "rates": ["20mm"],
            "tasks": {"registration": {}},
        },
        "real": {
            "scenes": "turns",
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


def jobs_of(flow: Workflow) -> dict[str, PlannedJob]:
    """Return the jobs of a plan, named after their rule, and what they make."""
    return dict(
        (*_of_clouds(flow), *_of_codecs(flow), *_of_drives(flow), *_of_study(flow), *_outputs(flow))
    )


def _of_clouds(flow: Workflow) -> Iterator[tuple[str, PlannedJob]]:
    plan, jobs = flow.plan, flow.clouds
    for name, scenes in plan.scenes.items():
        yield from ((f"scene {name}", jobs.scene(name, scene)) for scene in scenes.chosen)
    for dataset, cloud in plan.clouds:
        data = plan.datasets[dataset]
        makes = {"sample": jobs.sample, "scan": jobs.scan}
        if make := makes.get(data.settings.make):
            yield f"{data.settings.make} {dataset}", make(dataset, cloud)
        yield f"prepare {dataset}", jobs.prepare(dataset)


def _of_codecs(flow: Workflow) -> Iterator[tuple[str, PlannedJob]]:
    plan, jobs = flow.plan, flow.coding
    for curve in plan.curves:
        name = f"{curve[0]}/{curve[2]}"
        yield f"encode {name}", jobs.encode(*curve)
        yield f"evaluate {name}", jobs.evaluate(*curve)
        yield f"decode_shown {name}", jobs.decode_shown(*curve)
        rate = plan.rates(curve[2], plan.datasets[curve[0]].frame)[0]
        yield f"decode {name}", jobs.decode(curve[0], curve[2], rate)
    for dataset, _, codec in plan.recovered:
        yield f"recovery {dataset}/{codec}", jobs.recovery(dataset, codec)
    for dataset, _ in plan.scanned:
        yield f"scan_error {dataset}", jobs.scan_error(dataset)
    for name in plan.trainings:
        yield f"train {name}", flow.training.train(name)


def _of_drives(flow: Workflow) -> Iterator[tuple[str, PlannedJob]]:
    for name, entry in flow.drives.entries.items():
        yield from ((f"drive {name}", flow.drives.drive(name, drive)) for drive in entry.drives)
        yield f"measure_undecoded {name}", flow.drives.measure(name, "undecoded")
        for codec in entry.rates:
            yield f"encode_drive {name}/{codec}", flow.drives.encode(name, codec)
            yield f"measure_drive {name}/{codec}", flow.drives.measure(name, codec)


def _of_study(flow: Workflow) -> Iterator[tuple[str, PlannedJob]]:
    if flow.plan.study is None:
        return
    for model in flow.plan.study.models:
        yield f"residuals {model}", flow.study.residuals(model)
        yield f"wall_points {model}", flow.study.wall_points(model)
    for capture in flow.plan.study.captures:
        yield f"capture_residuals {capture}", flow.study.capture_residuals(capture)
    yield "calibration", flow.study.calibrate()
    yield from ((f"table {name}", each.job) for name, each in flow.study.gathered.items())


def _outputs(flow: Workflow) -> Iterator[tuple[str, PlannedJob]]:
    outputs = flow.outputs
    yield from ((f"table {name}", each.job) for name, each in outputs.gathered.items())
    yield from ((f"table {name}", outputs.table(name)) for name in outputs.tables)
    yield from ((f"figure {name}", outputs.figure(name)) for name in outputs.figures)
    yield "first_look", outputs.first_look.job
    yield "report", outputs.report
    yield "reference", outputs.reference


def _states(config: str) -> dict[str, list[str]]:
    jobs = jobs_of(Workflow(yaml.safe_load(Path(config).read_text())))
    return {name: [job.record, job.code] for name, job in jobs.items()}


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
