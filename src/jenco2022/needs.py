"""Which data sets and codecs of a run represent those of the thesis, and tables that need them."""

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
from puckbench.codecs.registry import open_codec
from puckbench.codecs.tmc13 import Tmc13
from puckbench.planning.needs.registry import NEEDS, Options

if TYPE_CHECKING:
    from puckbench.planning.config import DataSetConfig
    from puckbench.planning.plan import Plan, ScenePlan


_CLASSES: dict[str, tuple[type[Codec], ...]] = {
    DRACO: (Draco, DracoCli),
    PCGCV1: (Pcgcv1,),
    PCGCV2: (Pcgcv2,),
}


def dataset_roles(plan: Plan) -> dict[str, str]:
    """Return the role of each data set: the thesis's data set that it represents.

    A virtual scan has the role of the clean scans if its error model is ``none``, else of the noisy
    ones. A recorded cloud has the role of the rooms, a sampled mesh that of the sampled rooms if
    the plan also scans the mesh, else of the objects. Clouds in metres have no role.
    """
    sources = {name: _source(plan.scenes[data.scenes]) for name, data in plan.datasets.items()}
    scaled = {
        name: data.settings for name, data in plan.datasets.items() if not data.settings.is_metric
    }
    scanned = [sources[name] for name, settings in scaled.items() if settings.is_scan]
    return {
        name: _dataset_role(settings, sources[name] in scanned) for name, settings in scaled.items()
    }


def _source(scenes: ScenePlan) -> tuple[str, int, dict[str, Any]]:
    return scenes.loader, scenes.seed, scenes.options


def _dataset_role(settings: DataSetConfig, is_scanned: bool) -> str:
    if settings.is_scan:
        return CLEAN if settings.errors == "none" else NOISY
    if settings.make == "cloud":
        return ROOMS
    return SAMPLED if is_scanned else OBJECTS


def codec_role(codec: Codec) -> str:
    """Return the role of a codec: the thesis's codec that it represents, or an empty string.

    G-PCC's plain octree represents `GPCC_AS_RUN` if it truncates coordinates, otherwise `GPCC`.
    """
    if codec.based_on or (isinstance(codec, Draco) and codec.options.method == "sequential"):
        return ""
    if isinstance(codec, (Gpcc, Tmc13)):
        if codec.options.profile == "spinning" or isinstance(codec, GpccDenoised):
            return ""
        return GPCC_AS_RUN if codec.options.rounding == "truncate" else GPCC
    return next((role for role, classes in _CLASSES.items() if isinstance(codec, classes)), "")


def codec_roles(plan: Plan) -> dict[str, str]:
    return _first({name: codec_role(codec) for name, codec in plan.opened.items()})


def stand_in_roles(plan: Plan) -> dict[str, str]:
    """Return, by role, the codecs of the plan that stand in for the thesis's codecs.

    A codec stands in for the published codec that it modifies (`based_on`).
    """
    bases = {name: codec.based_on for name, codec in plan.opened.items()}
    return _first({name: codec_role(open_codec(base)) for name, base in bases.items() if base})


def _first(roles: Mapping[str, str]) -> dict[str, str]:
    names: dict[str, str] = {}
    for name, role in roles.items():
        if role:
            names.setdefault(role, name)
    return names


def grid_scales(plan: Plan) -> dict[str, dict[str, float]]:
    """Return the grid's scale by codec and rate, for G-PCC codecs of data sets with a role."""
    return {
        name: {rate: float(values["scale"]) for rate, values in codec.rates.items()}
        for name, codec in plan.opened.items()
        if codec_role(codec) in (GPCC, GPCC_AS_RUN)
        and all("scale" in values for values in codec.rates.values())
        and any(plan.codes(name, dataset) for dataset in dataset_roles(plan))
    }


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
