"""What replaces steps of Snakemake's planning: it finds what they find."""

from __future__ import annotations

import asyncio
import inspect
from types import SimpleNamespace
from typing import Any

import pytest
import snakemake.api  # noqa: F401 - its modules import each other, and this one comes first
from snakemake import common, dag, jobs, rules

from puckbench.planning.faster_snakemake import plan_faster


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Snakemake's own steps, which are there again after the test."""
    mintime = inspect.getattr_static(jobs.Job, "output_mintime")
    monkeypatch.setattr(dag.DAG, "check_directory_outputs", dag.DAG.check_directory_outputs)
    monkeypatch.setattr(jobs.Job, "output_mintime", mintime)
    for module in (common, rules):
        monkeypatch.setattr(module, "get_function_params", common.get_function_params)
    return SimpleNamespace(check=dag.DAG.check_directory_outputs, mintime=mintime.fget)


def test_all_steps_are_known_in_the_snakemake_that_is_installed(own: Any) -> None:
    assert plan_faster() == ["check_directory_outputs", "output_mintime", "get_function_params"]
    assert plan_faster() == []


def test_another_snakemake_keeps_its_own_steps(own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def check_directory_outputs(self: Any) -> None:
        """Not the one that ours was compared with."""

    monkeypatch.setattr(dag.DAG, "check_directory_outputs", check_directory_outputs)
    assert "check_directory_outputs" not in plan_faster()
    assert dag.DAG.check_directory_outputs is check_directory_outputs


class _Job:
    """A job of some outputs; jobs are sorted beside their outputs."""

    def __init__(self, *output: Any) -> None:
        self.output = output
        self.benchmark = None

    def __lt__(self, other: _Job) -> bool:
        return id(self) < id(other)


@pytest.mark.parametrize(
    ("outputs", "nested"),
    [
        ([["a/b"], ["a/c"]], False),
        ([["a/b"], ["a/b c"], ["a/b-c/d"]], False),
        ([["a"], ["a/b/c/d"]], True),
        ([["a", "a/b"]], False),  # of one job
    ],
)
def test_outputs_within_others_are_found(own: Any, outputs: list[Any], nested: bool) -> None:
    plan = SimpleNamespace(jobs=[_Job(*each) for each in outputs])
    plan_faster()
    for check in (own.check, dag.DAG.check_directory_outputs):
        if nested:
            with pytest.raises(Exception, match="child to another output"):
                check(plan)
        else:
            check(plan)


class _File:
    """An output that was written at some time, or is not there."""

    def __init__(self, written: float | None) -> None:
        self._written = written

    async def exists(self) -> bool:
        return self._written is not None

    async def mtime(self) -> Any:
        return SimpleNamespace(local_or_storage=lambda: self._written)


@pytest.mark.parametrize("times", [[], [None], [3.0, None, 2.0, 5.0]])
@pytest.mark.parametrize("benchmark", [None, 1.0])
def test_the_oldest_output_is_the_same(own: Any, times: list[Any], benchmark: Any) -> None:
    job = _Job(*map(_File, times))
    job.benchmark = _File(benchmark) if benchmark else None
    plan_faster()
    ours = inspect.getattr_static(jobs.Job, "output_mintime").fget
    assert ours is not own.mintime
    assert asyncio.run(ours(job)) == asyncio.run(own.mintime(job))


def test_parameters_of_functions_that_cannot_be_kept_are_looked_up(own: Any) -> None:
    class _Unhashable:
        __hash__ = None  # type: ignore[assignment]

        def __call__(self, wildcards: Any) -> None:
            """Do nothing."""

    plan_faster()
    assert list(common.get_function_params(_Unhashable())) == ["wildcards"]
    assert list(rules.get_function_params(lambda wildcards, output: 0)) == [
        "wildcards",
        "output",
    ]
