"""The thesis as a source of published numbers, beside the default run."""

from __future__ import annotations

import pandas as pd
import pytest

from jenco2022.published import medians_of_thesis
from puckbench.published_sources.beside import HERE, beside_published, curves_of
from puckbench.published_sources.registry import source_named
from puckbench.report.reference_results import read_reference

DATASETS = {"objects": "CAPOD", "rooms_noisy": "S3DIS scanned, noisy"}


@pytest.fixture(scope="module")
def points() -> pd.DataFrame:
    study = read_reference("default")
    clouds = study.table("clouds")
    assert clouds is not None
    return beside_published(study.metrics, clouds, DATASETS, [source_named("jenco2022")])


def test_the_source_has_every_median_of_the_thesis() -> None:
    rows = source_named("jenco2022").rows
    medians = medians_of_thesis()
    assert len(rows) == 2 * len(medians)
    of_objects = rows[rows["dataset"].eq("CAPOD") & rows["codec"].eq("Draco")]
    values = of_objects.loc[of_objects["measure"] == "cd_plane", "value"]
    assert values.tolist() == [433, 113, 26, 6.7, 1.6, 0.34, 0.086, 0.022]


def test_medians_of_the_run_are_beside_those_of_the_thesis(points: pd.DataFrame) -> None:
    metrics = read_reference("default").metrics
    own = metrics[metrics["dataset"].eq("objects") & metrics["codec"].eq("draco")]
    median = own[own["rate"] == "r3"]["cd_plane"].median()
    chosen = points[points["origin"].eq(HERE) & points["codec"].eq("draco")]
    chosen = chosen[chosen["rate"].eq("r3") & chosen["metric"].eq("cd_plane")]
    chosen = chosen[chosen["dataset"] == "objects"]
    assert chosen["measured"].tolist() == [pytest.approx(median)]
    assert set(points["cloud"]) == {"median"}


def test_every_condition_that_differs_is_named(points: pd.DataFrame) -> None:
    """The default run has six objects or rooms with fewer points, in the same cube."""
    theirs = points[points["origin"] == "Jenco 2022"]
    assert set(theirs["dataset"]) == set(DATASETS)
    assert (theirs["differs"] != "").all()
    assert theirs["differs"].str.contains("points ").all()
    assert theirs["differs"].str.contains("frames ").all()
    assert not theirs["differs"].str.contains("coordinates|peak|machine").any()
    draco = theirs[theirs["codec"] == "Draco"]["differs"]
    assert draco.str.contains(r"version not stated \(here draco ").all()
    for curve, rows in curves_of(points):
        assert len(set(rows["origin"])) == len(set(rows["differs"])) == 1, curve
