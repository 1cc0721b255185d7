"""Conditions on a plan that tables and figures name as their needs.

A need is a function of a plan. It returns options for the tables that have this need, usually none,
or None if the plan does not meet it::

    @NEEDS.register("codecs")
    def several_codecs(plan: Plan) -> Options | None:
        return {} if len(plan.codecs) > 1 else None
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from puckbench.core.registry import Registry
from puckbench.figures.registry import at
from puckbench.metrics.against_octree import OCTREE
from puckbench.planning.plan import DataSetPlan, Plan

Options = dict[str, Any]
Need = Callable[[Plan], Options | None]

NEEDS: Registry[Need] = Registry("need", "planning", "thesis")


def met_needs(plan: Plan) -> dict[str, Options]:
    """Return the needs that a plan meets, each with its options.

    Beside the registered ones these are the distances and error models of the sensor study.
    """
    options = {name: NEEDS.get(name)(plan) for name in NEEDS.names()}
    met = {name: value for name, value in options.items() if value is not None}
    if plan.study is not None:
        met |= {name: {} for name in (*map(at, plan.study.all_distances_m), *plan.study.models)}
    return met


@NEEDS.register("sensor_study")
def sensor_study(plan: Plan) -> Options | None:
    return _if(plan.study is not None)


@NEEDS.register("codecs")
def several_codecs(plan: Plan) -> Options | None:
    return _if(bool(plan.datasets) and len(plan.codecs) > 1)


@NEEDS.register("octree")
def octree_and_others(plan: Plan) -> Options | None:
    metric = {name for name, codec in plan.opened.items() if codec.rates_of("metric")}
    return _if(OCTREE in metric and len(metric) > 1)


@NEEDS.register("metric")
def spins_or_recordings(plan: Plan) -> Options | None:
    return _if(any(data.has_returns for data in plan.datasets.values()))


@NEEDS.register("spins")
def spins(plan: Plan) -> Options | None:
    return _if(bool(_true_spins(plan)))


@NEEDS.register("noises")
def several_noises(plan: Plan) -> Options | None:
    data = _true_spins(plan)
    models = {(each.scenes, each.settings.errors) for each in data}
    return _if(len(models) > len({each.scenes for each in data}))


def _true_spins(plan: Plan) -> list[DataSetPlan]:
    """Data sets with a sensor's returns and the surface that they come from."""
    return [data for data in plan.datasets.values() if data.has_returns and data.has_true_surface]


def _if(is_met: bool) -> Options | None:
    return {} if is_met else None
