"""Numbers of the README that the default configuration determines."""

from collections import Counter

from puckbench.planning.config import checked, read_config
from puckbench.planning.plan import Plan
from tests.support.pages import ROOT, page


def test_the_readme_counts_the_clouds_and_codecs_of_the_default_run() -> None:
    plan = Plan(checked(read_config(ROOT / "config" / "config.yaml")))
    codecs_of_cloud = Counter((dataset, cloud) for dataset, cloud, _ in plan.curves)
    clouds = Counter(
        ("street" if dataset == "spins" else "rooms", codecs)
        for (dataset, _), codecs in codecs_of_cloud.items()
    )
    assert clouds == {("rooms", 6): 20, ("street", 4): 6}
    text = " ".join(page("README.md").split())
    assert "codes 26 generated clouds in" in text
    assert "20 of objects and rooms with 6 codecs, and 6 of streets with 4." in text
