"""The profile for Slurm speaks of rules that there are, and its requests can be computed."""

import re
from inspect import signature
from pathlib import Path
from typing import Any

import pytest
import yaml

from puckbench.codecs.learned import Learned
from puckbench.codecs.registry import codec_class, codecs, open_codec
from puckbench.planning.costs import costs_of
from puckbench.planning.rules import RuleStep
from puckbench.steps.step import STEPS

WORKFLOW = Path(__file__).parents[3] / "workflow"
PROFILE = yaml.safe_load((WORKFLOW / "profiles" / "slurm" / "config.yaml").read_text())
RULES = {
    name
    for file in (WORKFLOW / "rules").glob("*.smk")
    for name in re.findall(r"^ *rule (\w+):$", file.read_text(), re.MULTILINE)
}
RESOURCES: dict[str, Any] = PROFILE["set-resources"]


def test_it_names_rules_that_exist() -> None:
    assert set(RESOURCES) <= RULES


def test_each_job_is_submitted_alone() -> None:
    """A curve is long enough for a job of its own."""
    assert not {"groups", "group-components"} & set(PROFILE)


@pytest.mark.parametrize("rule", RESOURCES)
def test_another_attempt_gets_more_time(rule: str) -> None:
    def asked(attempt: int) -> int:
        return int(eval(RESOURCES[rule]["runtime"], {"attempt": attempt}))  # noqa: S307

    assert asked(3) == 3 * asked(1)


def test_another_attempt_gets_more_memory() -> None:
    """In every rule whose memory depends on the cloud or the codec."""
    texts = [file.read_text() for file in (WORKFLOW / "rules").glob("*.smk")]
    asked = [line for text in texts for line in text.splitlines() if "mem_mb=" in line]
    assert len(asked) == len(STEPS.names())
    assert all(line.endswith(".memory_mb,") for line in asked)
    parameters = signature(RuleStep.memory_mb).parameters
    assert "attempt" in parameters


@pytest.mark.parametrize("codec", codecs())
def test_a_network_gets_most_memory(codec: str) -> None:
    memory_mb = costs_of(open_codec(codec)).memory_of(1_000_000)
    is_large = issubclass(codec_class(codec), Learned) and codec != "lizip"  # without PyTorch
    assert (memory_mb > 2000) == is_large
