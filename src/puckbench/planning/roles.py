"""Which data set and which codec of a run stands for which of the thesis's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from puckbench.codecs.registry import open_codec
from puckbench.planning.config import DataSetConfig
from puckbench.planning.plan import Plan, ScenePlan
from puckbench.thesis.claims.roles import GPCC, GPCC_AS_RUN, RATES, SAMPLED
from puckbench.thesis.published_rates import CLEAN, NOISY, OBJECTS, ROOMS


def dataset_roles(plan: Plan) -> dict[str, str]:
    """Data set -> one of `DATASETS`.

    A scan is clean where its error model is ``none``. Clouds that were captured are rooms, and so
    are samples of scenes that come from where those come from that another data set scans; other
    samples are objects. Clouds in metres are none of the thesis's.
    """
    sources = {name: _source(plan.scenes[data.scenes]) for name, data in plan.datasets.items()}
    scans = [
        name
        for name, data in plan.datasets.items()
        if data.settings.is_scan and not data.settings.is_metric
    ]
    scanned = [sources[name] for name in scans]
    return {
        name: _dataset_role(data.settings, sources[name] in scanned)
        for name, data in plan.datasets.items()
        if not data.settings.is_metric
    }


def _source(scenes: ScenePlan) -> tuple[str, int, dict[str, Any]]:
    return scenes.loader, scenes.seed, scenes.options


def _dataset_role(settings: DataSetConfig, scanned: bool) -> str:
    if settings.is_scan:
        return CLEAN if settings.errors == "none" else NOISY
    if settings.make == "cloud":
        return ROOMS
    return SAMPLED if scanned else OBJECTS


def codec_roles(plan: Plan) -> dict[str, str]:
    """Role -> the first codec that says that it plays it (`Codec.thesis_role`).

    G-PCC with truncated coordinates is `GPCC_AS_RUN`, as the thesis ran it; rounded once, `GPCC`.
    """
    return _first({name: codec.thesis_role for name, codec in plan.opened.items()})


def stand_in_roles(plan: Plan) -> dict[str, str]:
    """Role -> the first codec that changes the codec of this role (`Codec.based_on`)."""
    bases = {name: codec.based_on for name, codec in plan.opened.items()}
    return _first({name: open_codec(base).thesis_role for name, base in bases.items() if base})


def _first(roles: Mapping[str, str]) -> dict[str, str]:
    """Role -> the first name that has it; some have none."""
    found: dict[str, str] = {}
    for name, role in roles.items():
        if role:
            found.setdefault(role, name)
    return found


def verdict_options(plan: Plan) -> dict[str, dict[str, Any]]:
    """The tables of `puckbench.metrics.registry.TABLES` that a plan allows, with their options.

    The thesis's medians need a data set and a codec like the thesis's, with a rate of its name.
    """
    datasets, codecs, scales = dataset_roles(plan), codec_roles(plan), grid_scales(plan)
    played = {"datasets": datasets, "codecs": codecs}
    if plan.datasets and not datasets and plan.study is None:
        return {}
    options: dict[str, dict[str, Any]] = {"claims": {**played, "stand_ins": stand_in_roles(plan)}}
    if datasets and scales:
        chosen = {role: name for role, name in codecs.items() if role in (GPCC, GPCC_AS_RUN)}
        options["gpcc_scales"] = {"codecs": chosen, "scales": scales}
    if datasets and any(plan.codecs[name]["rates"].keys() & RATES for name in codecs.values()):
        options["thesis_medians"] = played
    return options


def grid_scales(plan: Plan) -> dict[str, dict[str, float]]:
    """Codec -> rate -> scale, of the G-PCC codecs that code a data set like the thesis's."""
    return {
        name: {rate: float(values["scale"]) for rate, values in codec.rates.items()}
        for name, codec in plan.opened.items()
        if codec.thesis_role in (GPCC, GPCC_AS_RUN)
        and all("scale" in values for values in codec.rates.values())
        and any(plan.codes(name, dataset) for dataset in dataset_roles(plan))
    }
