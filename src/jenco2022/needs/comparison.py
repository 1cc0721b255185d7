from __future__ import annotations

from jenco2022.claims.roles import GPCC, GPCC_AS_RUN, RATES
from jenco2022.representatives import codec_roles, dataset_roles, grid_scales, stand_in_roles
from puckbench.planning.needs.registry import NEEDS, Options
from puckbench.planning.plan import Plan


@NEEDS.register("claims")
def claims_options(plan: Plan) -> Options | None:
    """Return the roles of data sets and codecs; None if there are no roles and no sensor study."""
    datasets = dataset_roles(plan)
    if plan.datasets and not datasets and plan.study is None:
        return None
    return {"datasets": datasets, "codecs": codec_roles(plan), "stand_ins": stand_in_roles(plan)}


@NEEDS.register("gpcc_scales")
def gpcc_scales_options(plan: Plan) -> Options | None:
    scales = grid_scales(plan)
    codecs = {role: name for role, name in codec_roles(plan).items() if role in (GPCC, GPCC_AS_RUN)}
    return {"codecs": codecs, "scales": scales} if scales else None


@NEEDS.register("thesis_medians")
def thesis_medians_options(plan: Plan) -> Options | None:
    """Return the roles of data sets and codecs; None without roles or the thesis's rates."""
    datasets, codecs = dataset_roles(plan), codec_roles(plan)
    has_rates = any(plan.codecs[name]["rates"].keys() & RATES for name in codecs.values())
    return {"datasets": datasets, "codecs": codecs} if datasets and has_rates else None


@NEEDS.register("rounded_and_truncated_gpcc")
def rounded_and_truncated_gpcc(plan: Plan) -> Options | None:
    return {} if codec_roles(plan).keys() >= {GPCC, GPCC_AS_RUN} else None
