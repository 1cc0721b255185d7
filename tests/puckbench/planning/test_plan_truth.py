"""What a configuration makes of true surfaces and of labels of geometric primitives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from puckbench.planning.workflow import Workflow

ROOT = Path(__file__).parents[3]
ROOMS = {"loader": "embedded_rooms", "select": ["office_1"]}
SCAN = {"scene_set": "rooms", "make": "scan", "sweep": {"duration_s": 0.02}}
SAMPLE = {"scene_set": "rooms", "make": "sample"}
TRUTH_FIGURES = {"truth_rd", "truth_rd_point", "truth_rd_hausdorff", "truth_accuracy"}


def workflow(
    datasets: dict[str, Any], codecs: dict[str, Any] | None = None, **scenes: Any
) -> Workflow:
    codecs = codecs or {"primitives": {"rates": ["r4"]}, "draco": {"rates": ["r1"]}}
    scenes = {"rooms": ROOMS, **scenes}
    return Workflow({"scene_sets": scenes, "datasets": datasets, "codecs": codecs})


def tables_of_rows(bench: Workflow) -> dict[str, tuple[str, ...]]:
    return {kind: item.names for kind, item in bench.outputs.gathered.items()}


def test_scans_are_measured_against_the_truth_and_the_clean_scan() -> None:
    bench = workflow({"scanned": SCAN, "sampled": SAMPLE})
    assert set(bench.files.truth("scanned", "office_1")) == {"truth", "clean"}
    assert set(bench.files.truth("sampled", "office_1")) == {"truth", "visible"}
    assert tables_of_rows(bench)["scan_errors"] == ("scan_errors/scanned/office_1.json",)
    assert set(bench.outputs.figures) >= TRUTH_FIGURES
    assert set(bench.outputs.tables["nearest_truth"]) == {"metrics", "scan_errors"}
    assert bench.outputs.table_options("nearest_truth") == {}
    assert bench.outputs.table_options("truth_bits") == {"anchor": "primitives"}


@pytest.mark.parametrize("data", [SAMPLE, {**SCAN, "truth": False}], ids=["sample", "off"])
def test_without_a_scan_from_a_known_surface_there_is_no_such_figure(data: dict[str, Any]) -> None:
    bench = workflow({"data": data})
    assert "scan_errors" not in tables_of_rows(bench)
    assert set(bench.outputs.figures) & TRUTH_FIGURES == set()
    assert "nearest_truth" not in bench.outputs.tables


def test_primitives_are_compared_where_scenes_and_codec_have_them() -> None:
    bench = workflow({"scanned": SCAN, "sampled": SAMPLE})
    assert bench.plan.recovered == (
        ("scanned", "office_1", "primitives"),
        ("sampled", "office_1", "primitives"),
    )
    assert "recovery_rd" in bench.outputs.figures


@pytest.mark.parametrize(
    ("data", "codecs"),
    [
        ({**SCAN, "recovery": False}, None),
        ({**SCAN, "scene_set": "meshes"}, None),
        (SCAN, {"draco": {"rates": ["r1"]}}),
    ],
    ids=["switched off", "scenes without primitives", "codec of points"],
)
def test_without_labels_or_surfaces_nothing_is_compared(
    data: dict[str, Any], codecs: dict[str, Any] | None, tmp_path: Path
) -> None:
    (tmp_path / "a.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    meshes = {"loader": "mesh_files", "options": {"path": str(tmp_path)}}
    bench = workflow({"scanned": data}, codecs, meshes=meshes)
    assert bench.plan.recovered == ()
    assert "recovery" not in tables_of_rows(bench)
    assert "recovery_rd" not in bench.outputs.figures


OWN = """
from puckbench.codecs.base import Codec
class Own(Codec):
    def encode(self, cloud, rate):
        return cloud.xyz.tobytes()
    def decode(self, stream):
        raise NotImplementedError
"""


def test_a_codec_of_ones_own_says_that_it_codes_surfaces(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    own = {"class": f"{tmp_path}/own.py:Own", "rates": {"r1": {}}}
    names = {"a": {**own, "surfaces": True}, "b": own}
    assert {cell[2] for cell in workflow({"scanned": SCAN}, names).plan.recovered} == {"a"}
