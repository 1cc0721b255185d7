"""Further metrics: ours, a user's own, and those that cannot be used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.registry import trust
from puckbench.metrics.density import density
from puckbench.metrics.metric_registry import FurtherMetrics, further_metrics
from puckbench.planning.config import trusted
from puckbench.planning.plan import Plan

POINTS = np.random.default_rng(1).random((400, 3)) * 10
OWN_CLASS = """
class Counted:
    made = 0

    def __init__(self, reference, *, factor=1):
        Counted.made += 1
        self.points, self.factor = len(reference), factor

    def __call__(self, decoded):
        return {"counted": self.factor * (self.points + len(decoded)), "made": Counted.made}
"""
USER_METRIC = """
def moved(reference, decoded):
    return {"moved": float((decoded.xyz - reference.xyz).mean())}
"""


def test_density_of_the_decoded_cloud_is_in_metres() -> None:
    reference = PointCloud(POINTS, about={"scale": 20.0})
    values = further_metrics(["density"], reference, PointCloud(POINTS[:300]), {})
    metres = density(POINTS[:300] / 20)
    assert values["decoded_spacing_median_m"] == pytest.approx(metres["spacing_median"])
    assert values["decoded_density_q95_m2"] == pytest.approx(metres["density_q95"])


def test_a_function_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(USER_METRIC)
    trust([place := f"{tmp_path / 'own.py'}:moved"])
    clouds = PointCloud(POINTS), PointCloud(POINTS + 2)
    assert further_metrics([place], *clouds, {})["moved"] == pytest.approx(2)
    with pytest.raises(InputError, match="the column 'moved' exists already"):
        further_metrics([place], *clouds, {"moved": 1})


def test_a_class_is_created_once_for_all_clouds_of_an_original(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN_CLASS)
    trust([place := f"{tmp_path / 'own.py'}:Counted"])
    metrics = FurtherMetrics({place: {"factor": 2}}, PointCloud(POINTS))
    rows = [metrics.of(PointCloud(POINTS[:count]), ()) for count in (10, 20)]
    assert rows == [{"counted": 820, "made": 1}, {"counted": 840, "made": 1}]
    with pytest.raises(InputError, match=r"Counted: options: .*'factr'"):
        FurtherMetrics({place: {"factr": 2}}, PointCloud(POINTS))


@pytest.mark.parametrize(
    ("metrics", "fault"),
    [
        ({"density": {"k": 3}}, r"^datasets\.objects\.metrics: metric density: options: .*'k'"),
        ({"mininet": {}}, r"^datasets\.objects\.metrics: metric mininet: options: .*'weights'"),
        ({"densty": {}}, r"^datasets\.objects\.metrics: unknown metric 'densty'"),
    ],
)
def test_options_of_a_data_sets_metrics_are_checked_before_anything_runs(
    metrics: dict[str, dict[str, int]], fault: str
) -> None:
    data = {"scene_set": "objects", "make": "sample", "metrics": metrics}
    sets = {"objects": {"loader": "embedded_objects"}}
    with pytest.raises(InputError, match=fault):
        Plan(trusted({"scene_sets": sets, "datasets": {"objects": data}}))


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("densty", r"^metrics: unknown metric 'densty' .* did you mean 'density'"),
        ("no_such.py:f", r"^metrics: metric no_such.py:f: cannot load"),
    ],
)
def test_a_metric_that_does_not_exist_is_named_before_anything_runs(name: str, fault: str) -> None:
    config = {
        "scene_sets": {"objects": {"loader": "embedded_objects"}},
        "datasets": {"objects": {"scene_set": "objects", "make": "sample"}},
    }
    Plan(trusted({**config, "metrics": ["density"]}))
    with pytest.raises(InputError, match=fault):
        Plan(trusted({**config, "metrics": [name]}))
