"""The profile for Slurm speaks of rules that there are, and its requests can be computed."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from puckbench.codecs.registry import codecs, has_weights

WORKFLOW = Path(__file__).parents[2] / "workflow"
PROFILE = yaml.safe_load((WORKFLOW / "profiles" / "slurm" / "config.yaml").read_text())
RULES = {
    name
    for file in (WORKFLOW / "rules").glob("*.smk")
    for name in re.findall(r"^ *rule (\w+):$", file.read_text(), re.MULTILINE)
}
GROUPS = dict(pair.split("=") for pair in PROFILE["groups"])
RESOURCES: dict[str, Any] = PROFILE["set-resources"]


def test_it_names_rules_that_exist() -> None:
    assert set(GROUPS) | set(RESOURCES) <= RULES


def test_every_group_has_a_size() -> None:
    sizes = dict(pair.split("=") for pair in PROFILE["group-components"])
    assert set(sizes) == set(GROUPS.values())
    assert all(int(size) > 1 for size in sizes.values())


@pytest.mark.parametrize("codec", codecs())
@pytest.mark.parametrize("rule", RESOURCES)
def test_another_attempt_gets_more_and_a_network_gets_most(rule: str, codec: str) -> None:
    def asked(resource: str, attempt: int) -> int:
        known = {"attempt": attempt, "wildcards": SimpleNamespace(codec=codec)}
        return int(eval(RESOURCES[rule][resource], known))  # noqa: S307 (as Snakemake does)

    for resource in ("mem_mb", "runtime"):
        assert asked(resource, 3) == 3 * asked(resource, 1)
    if "codec" in RESOURCES[rule]["mem_mb"]:
        assert (asked("mem_mb", 1) > 2000) == has_weights(codec)
