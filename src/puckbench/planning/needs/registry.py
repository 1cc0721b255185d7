"""Conditions on a plan (needs), which tables and figures refer to by name.

A need is a function of a plan. It returns options for the table functions with this need, or None
if the plan does not meet it::

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
    """Return the needs that a plan meets, by name, with their options for table functions.

    Names of distances and error models of the plan's sensor study are needs, too.
    """
    options = {name: NEEDS.get(name)(plan) for name in NEEDS.names()}
    met = {name: value for name, value in options.items() if value is not None}
    if plan.study is not None:
        met |= {name: {} for name in (*map(at, plan.study.all_distances_m), *plan.study.models)}
    return met
