"""Registry of needs: conditions that a run must meet for a table or figure to be made.

Tables and figures list their needs by name. A need is a function that takes the plan of a run. It
returns None if the plan does not meet the condition. Otherwise it returns a dictionary with keyword
arguments for the functions of the tables that have this need, often an empty one::

    @NEEDS.register("codecs")
    def several_codecs(plan: Plan) -> Options | None:
        return {} if len(plan.codecs) > 1 else None
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pointkit.registry import Registry
from puckbench.figures.registry import at
from puckbench.planning.plan import Plan

Options = dict[str, Any]
Need = Callable[[Plan], Options | None]

NEEDS: Registry[Need] = Registry("need", "needs")


def met_needs(plan: Plan) -> dict[str, Options]:
    """Return the needs that a plan meets, each with keyword arguments for table functions.

    The keys are the needs' names. If the plan has a sensor study, each of its distances and error
    models also is a need that the plan meets.
    """
    options = {name: NEEDS.get(name)(plan) for name in NEEDS.names()}
    met = {name: value for name, value in options.items() if value is not None}
    if plan.study is not None:
        met |= {name: {} for name in (*map(at, plan.study.all_distances_m), *plan.study.models)}
    return met
