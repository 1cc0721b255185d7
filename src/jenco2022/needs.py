"""Which data sets and codecs of a run represent those of the thesis, and options of tables that use
them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from jenco2022.published import (
    CLEAN,
    DRACO,
    GPCC,
    GPCC_AS_RUN,
    NOISY,
    OBJECTS,
    PCGCV1,
    PCGCV2,
    RATES,
    ROOMS,
    SAMPLED,
)
from puckbench.codecs.base import Codec
from puckbench.codecs.draco import Draco
from puckbench.codecs.draco_tools import DracoCli
from puckbench.codecs.gpcc import Gpcc
from puckbench.codecs.gpcc_denoised import GpccDenoised
from puckbench.codecs.pcgcv1 import Pcgcv1
from puckbench.codecs.pcgcv2 import Pcgcv2
from puckbench.codecs.rates import budgets_of, scaled_rates
from puckbench.codecs.registry import based_on, open_codec
from puckbench.codecs.tmc13 import Tmc13
from puckbench.planning.needs.registry import NEEDS, Options

if TYPE_CHECKING:
    from puckbench.planning.config import DataSetConfig
    from puckbench.planning.plan import Plan, SceneSetPlan


LOADERS = ("capod", "s3dis", "stanford2d3d")
"""Loaders of the thesis's data sets."""

_CLASSES: dict[str, tuple[type[Codec], ...]] = {
    DRACO: (Draco, DracoCli),
    PCGCV1: (Pcgcv1,),
    PCGCV2: (Pcgcv2,),
}


def is_compared(plan: Plan) -> bool:
    """Return whether a run is compared with the thesis.

    The configuration's key ``thesis`` says so. Without it, runs are compared that have a scene set
    of the thesis's data (`LOADERS`).
    """
    if plan.config.thesis is None:
        return any(scenes.loader in LOADERS for scenes in plan.scene_sets.values())
    return plan.config.thesis


def dataset_roles(plan: Plan) -> dict[str, str]:
    """Return which of the thesis's data sets the data sets of a run represent.

    Data sets of a run that is not compared with the thesis represent none.

    A virtual scan represents the clean scans if its error model is ``none``; otherwise, it
    represents the noisy scans. A recorded cloud represents the rooms. A sampled mesh represents the
    sampled rooms if the run also scans the mesh; otherwise, it represents the objects. Clouds in
    metres represent none.

    Returns
    -------
    dict
        Roles (names of the thesis's data sets) by name of the run's data set.
    """
    if not is_compared(plan):
        return {}
    sources = {
        name: _source(plan.scene_sets[data.scene_set]) for name, data in plan.datasets.items()
    }
    scaled = {
        name: data.settings for name, data in plan.datasets.items() if not data.settings.is_metric
    }
    scanned = [sources[name] for name, settings in scaled.items() if settings.is_scan]
    return {
        name: _dataset_role(settings, sources[name] in scanned) for name, settings in scaled.items()
    }


def _source(scenes: SceneSetPlan) -> tuple[str, int, dict[str, Any]]:
    return scenes.loader, scenes.seed, scenes.options


def _dataset_role(settings: DataSetConfig, is_scanned: bool) -> str:
    if settings.is_scan:
        return CLEAN if settings.errors == "none" else NOISY
    if settings.make == "cloud":
        return ROOMS
    return SAMPLED if is_scanned else OBJECTS


def codec_role(codec: Codec) -> str:
    """Return which of the thesis's codecs a codec represents, or an empty text.

    G-PCC's plain octree represents `GPCC_AS_RUN` if it truncates coordinates, otherwise `GPCC`.
    """
    if based_on(codec) or (isinstance(codec, Draco) and codec.options.method == "sequential"):
        return ""
    if isinstance(codec, (Gpcc, Tmc13)):
        if codec.options.profile == "spinning" or isinstance(codec, GpccDenoised):
            return ""
        return GPCC_AS_RUN if codec.options.rounding == "truncate" else GPCC
    return next((role for role, classes in _CLASSES.items() if isinstance(codec, classes)), "")


def codec_roles(plan: Plan) -> dict[str, str]:
    """Return the names of the run's codecs that represent codecs of the thesis.

    Returns
    -------
    dict
        Names by role, i.e. by the name of the thesis's codec.
    """
    return _first({name: codec_role(codec) for name, codec in plan.opened.items()})


def stand_in_roles(plan: Plan) -> dict[str, str]:
    """Return the names of the run's codecs that stand in for codecs of the thesis.

    A codec stands in for the published codec that it modifies (`based_on`).

    Returns
    -------
    dict
        Names by role, i.e. by the name of the thesis's codec.
    """
    bases = {name: based_on(codec) for name, codec in plan.opened.items()}
    return _first({name: codec_role(open_codec(base)) for name, base in bases.items() if base})


def _first(roles: Mapping[str, str]) -> dict[str, str]:
    names: dict[str, str] = {}
    for name, role in roles.items():
        if role:
            names.setdefault(role, name)
    return names


def grid_scales(plan: Plan) -> dict[str, dict[str, float]]:
    """Return the scale of the grid for each rate of the run's G-PCC codecs.

    Returns
    -------
    dict
        Scales by codec and rate. Codecs are left out if they code no data set that represents one
        of the thesis's.
    """
    return {
        name: {rate: float(values["scale"]) for rate, values in scaled_rates(codec.rates).items()}
        for name, codec in plan.opened.items()
        if codec_role(codec) in (GPCC, GPCC_AS_RUN)
        and not budgets_of(codec)
        and all("scale" in values for values in scaled_rates(codec.rates).values())
        and any(plan.codes(name, dataset) for dataset in dataset_roles(plan))
    }


@NEEDS.register("thesis")
def compared_with_thesis(plan: Plan) -> Options | None:
    """Require that the run is compared with the thesis."""
    return {} if is_compared(plan) else None


@NEEDS.register("claims")
def claims_options(plan: Plan) -> Options | None:
    """Return the options of the table of claims: which data sets and codecs represent the thesis's.

    The result is None if the run is not compared with the thesis, or if it has neither such data
    sets nor a sensor study.
    """
    datasets = dataset_roles(plan)
    if not is_compared(plan) or (plan.datasets and not datasets and plan.study is None):
        return None
    return {"datasets": datasets, "codecs": codec_roles(plan), "stand_ins": stand_in_roles(plan)}


@NEEDS.register("gpcc_scales")
def gpcc_scales_options(plan: Plan) -> Options | None:
    """Return the options of the table ``gpcc_scales``, or None if no G-PCC codec has scales."""
    scales = grid_scales(plan)
    codecs = {role: name for role, name in codec_roles(plan).items() if role in (GPCC, GPCC_AS_RUN)}
    return {"codecs": codecs, "scales": scales} if scales else None


@NEEDS.register("thesis_medians")
def thesis_medians_options(plan: Plan) -> Options | None:
    """Return the options of the table ``thesis_medians``, or None if the run cannot fill it.

    The options are the data sets and codecs that represent those of the thesis. The result is None
    without such data sets, or if no codec has a rate of the thesis.
    """
    datasets, codecs = dataset_roles(plan), codec_roles(plan)
    has_rates = any({*plan.rates(name, "scaled")} & {*RATES} for name in codecs.values())
    return {"datasets": datasets, "codecs": codecs} if datasets and has_rates else None


@NEEDS.register("rounded_and_truncated_gpcc")
def rounded_and_truncated_gpcc(plan: Plan) -> Options | None:
    """Return empty options if the run has both kinds of G-PCC, otherwise None.

    One of them rounds coordinates, the other one truncates them.
    """
    return {} if codec_roles(plan).keys() >= {GPCC, GPCC_AS_RUN} else None
