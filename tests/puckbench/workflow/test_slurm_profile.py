"""The profile for Slurm speaks of rules that there are, and its requests can be computed."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from puckbench.codecs.learned import Learned
from puckbench.codecs.registry import codec_class, codecs

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
    asked = [line for text in texts for line in text.splitlines() if ".memory_mb(" in line]
    assert len(asked) == 13
    assert all("lambda w, attempt" in line for line in asked if "training" not in line)
    assert all("attempt * " in line for line in asked if "training" not in line)


@pytest.mark.parametrize("codec", codecs())
def test_a_network_gets_most_memory(codec: str) -> None:
    assert (codec_class(codec).memory.of(1_000_000) > 2000) == issubclass(
        codec_class(codec), Learned
    )
