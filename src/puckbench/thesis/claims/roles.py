"""Which data set and which codec of a run stands for which of the thesis's.

Imports nothing heavy: the workflow plans with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from puckbench.planning.plan import Plan, ScenePlan
from puckbench.thesis.published_rates import CLEAN, NOISY, OBJECTS, ROOMS

SAMPLED = "sampled rooms"
"""Rooms whose points were drawn on their meshes: their counts are a setting, not a measurement."""

DRACO, GPCC, GPCC_AS_RUN, PCGCV1, PCGCV2 = "draco", "gpcc", "gpcc_as_run", "pcgcv1", "pcgcv2"
CLASSICAL = (DRACO, GPCC_AS_RUN, GPCC)
LEARNED = (PCGCV1, PCGCV2)
SCANS = (CLEAN, NOISY)
ALL_ROOMS = (ROOMS, SAMPLED)
DATASETS = (OBJECTS, ROOMS, SAMPLED, CLEAN, NOISY)

RATES = frozenset(f"r{number}" for number in range(1, 9))
"""Names of the thesis's rates."""

_CLASSES = {
    "puckbench.codecs.draco:Draco": DRACO,
    "puckbench.codecs.external.draco_tools:DracoCli": DRACO,
    "puckbench.codecs.learned.pcgcv1.codec:Pcgcv1": PCGCV1,
    "puckbench.codecs.learned.pcgcv2.codec:Pcgcv2": PCGCV2,
}
_GPCC_CLASSES = ("puckbench.codecs.gpcc.codec:Gpcc", "puckbench.codecs.external.tmc13:Tmc13")


def dataset_roles(plan: Plan) -> dict[str, str]:
    """Data set -> one of `DATASETS`.

    A scan is clean where its error model is ``none``. Clouds that were captured are rooms, and so
    are samples of scenes that come from where those come from that another data set scans; other
    samples are objects.
    """
    sources = {name: _source(plan.scenes[data.scenes]) for name, data in plan.datasets.items()}
    scans = [name for name, data in plan.datasets.items() if data.settings["make"] == "scan"]
    scanned = [sources[name] for name in scans]
    return {
        name: _dataset_role(data.settings, sources[name] in scanned)
        for name, data in plan.datasets.items()
    }


def _source(scenes: ScenePlan) -> tuple[str, int, dict[str, Any]]:
    return scenes.loader, scenes.seed, scenes.options


def _dataset_role(settings: Mapping[str, Any], scanned: bool) -> str:
    if settings["make"] == "scan":
        return CLEAN if settings["errors"] == "none" else NOISY
    if settings["make"] == "cloud":
        return ROOMS
    return SAMPLED if scanned else OBJECTS


def codec_roles(plan: Plan) -> dict[str, str]:
    """Role -> the first codec that has it, by its class and how it rounds; others have none.

    G-PCC with truncated coordinates is `GPCC_AS_RUN`, as the thesis ran it; rounded once, `GPCC`.
    """
    roles: dict[str, str] = {}
    for name, entry in plan.codecs.items():
        if role := _codec_role(entry):
            roles.setdefault(role, name)
    return roles


def verdict_options(plan: Plan) -> dict[str, dict[str, Any]]:
    """The tables of `puckbench.thesis.tables.VERDICTS` that a plan allows, with their options.

    The thesis's medians need a data set and a codec like the thesis's, with a rate of its name.
    """
    datasets, codecs, scales = dataset_roles(plan), codec_roles(plan), grid_scales(plan)
    played = {"datasets": datasets, "codecs": codecs}
    options: dict[str, dict[str, Any]] = {"claims": played}
    if datasets and scales:
        chosen = {role: name for role, name in codecs.items() if role in (GPCC, GPCC_AS_RUN)}
        options["gpcc_scales"] = {"codecs": chosen, "scales": scales}
    if datasets and any(plan.codecs[name]["rates"].keys() & RATES for name in codecs.values()):
        options["thesis_medians"] = played
    return options


def grid_scales(plan: Plan) -> dict[str, dict[str, float]]:
    """Codec -> rate -> scale, of the G-PCC codecs."""
    return {
        name: {rate: float(values["scale"]) for rate, values in entry["rates"].items()}
        for name, entry in plan.codecs.items()
        if entry["class"] in _GPCC_CLASSES and all("scale" in v for v in entry["rates"].values())
    }


def _codec_role(entry: Mapping[str, Any]) -> str | None:
    if entry["class"] in _GPCC_CLASSES:
        truncated = entry["options"].get("rounding") == "truncate"
        return GPCC_AS_RUN if truncated else GPCC
    return _CLASSES.get(entry["class"])
