"""Further metrics: ours, a user's own, and those that cannot be used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.registry import trust
from puckbench.metrics.density import density
from puckbench.metrics.metric_registry import further_metrics
from puckbench.planning.config import trusted
from puckbench.planning.plan import Plan

POINTS = np.random.default_rng(1).random((400, 3)) * 10
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
