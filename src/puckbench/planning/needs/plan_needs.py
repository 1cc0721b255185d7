"""Needs of puckbench's tables and figures: each returns ``{}`` if a plan meets it, or None."""

from __future__ import annotations

from pointkit.errors import InputError, among, naming
from puckbench.codecs.base import Codec
from puckbench.codecs.rates import rates_of
from puckbench.geometry.attributes import RETURNS
from puckbench.metrics.metric_registry import METRICS, Metric
from puckbench.metrics.segmentation import PREFIXES
from puckbench.metrics.task_measures import with_margins
from puckbench.metrics.task_registry import TASKS, Task
from puckbench.planning.needs.registry import NEEDS, Options
from puckbench.planning.plan import DataSetPlan, Plan
from puckbench.tables.against_octree import OCTREE


@NEEDS.register("sensor_study")
def sensor_study(plan: Plan) -> Options | None:
    """Require that the run has a sensor study."""
    return _if(plan.study is not None)


@NEEDS.register("codecs")
def several_codecs(plan: Plan) -> Options | None:
    """Require that at least two codecs code clouds."""
    return _if(len({codec for _, _, codec in plan.curves}) > 1)


@NEEDS.register("odometry")
def odometry_on_drives(plan: Plan) -> Options | None:
    """Require that an odometry task is measured on drives, i.e. sequences of clouds.

    Tables get the configured margins, if they differ from the defaults.
    """
    tasks = {task for drive in plan.drives.values() for task in drive.tasks}
    if not tasks & {"odometry", "gicp_odometry"}:
        return None
    margins = plan.config.odometry_margins.model_dump(exclude_defaults=True)
    return {"margins": margins} if margins else {}


@NEEDS.register("perception")
def tasks_with_margins(plan: Plan) -> Options | None:
    """Require a metric or a drive's task that declares by what it is judged.

    Tables get these measures, with the configured margins, and the names of codecs whose errors are
    along the sensor's rays.
    """
    tasks: dict[str, Metric | Task] = {}
    for dataset in {data.name: data for data in plan.coded}:
        tasks |= {name: METRICS.get(name) for name in plan.metrics_of(dataset)}
    for drive in plan.drives.values():
        tasks |= {name: TASKS.get(name) for name in drive.tasks}
    measures = [each for task in tasks.values() for each in task.measures]
    if not measures:
        return None
    with naming("task_margins"):
        judged = with_margins(measures, plan.config.task_margins)
    along_rays = [name for name, codec in plan.opened.items() if codec.along_rays]
    described = [each.model_dump(mode="json") for each in judged]
    return {"measures": described, "along_rays": along_rays}


@NEEDS.register("segmentation")
def segmentation_metrics(plan: Plan) -> Options | None:
    """Require that a coded data set is segmented."""
    return _if(any({*PREFIXES} & plan.metrics_of(data.name).keys() for data in plan.coded))


@NEEDS.register("attributes")
def coded_attributes(plan: Plan) -> Options | None:
    """Require that at least one codec codes attributes besides coordinates, and tells their bits.

    A codec of a user that does not define `attribute_bytes` does not tell them.
    """
    return _if(
        any(
            {*codec.attributes} - {RETURNS}
            and type(codec).attribute_bytes is not Codec.attribute_bytes
            for codec in plan.opened.values()
        )
    )


@NEEDS.register("octree")
def octree_and_others(plan: Plan) -> Options | None:
    """Require that G-PCC's octree and another codec have rates for clouds in metres."""
    metric = {name for name, codec in plan.opened.items() if rates_of(codec, "metric")}
    return _if(OCTREE in metric and len(metric) > 1)


@NEEDS.register("metric")
def spins_or_recordings(plan: Plan) -> Options | None:
    """Require that at least one coded data set has a spinning sensor's returns."""
    return _if(any(data.has_returns for data in plan.coded))


@NEEDS.register("spins")
def spins(plan: Plan) -> Options | None:
    """Require that a coded data set has scans of a spinning virtual sensor, level and still."""
    return _if(bool(_true_spins(plan)))


@NEEDS.register("truth")
def scans_with_truth(plan: Plan) -> Options | None:
    """Require that at least one coded data set has scans of a known true surface."""
    return _if(any(data.is_scanned_from_truth for data in plan.coded))


@NEEDS.register("noises")
def several_noises(plan: Plan) -> Options | None:
    """Require that scans of a scene set with several error models are coded."""
    data = _true_spins(plan)
    models = {(each.scene_set, each.settings.errors) for each in data}
    return _if(len(models) > len({each.scene_set for each in data}))


@NEEDS.register("published")
def published_datasets(plan: Plan) -> Options | None:
    """Require that a data set has the key ``published``, and that a codec encodes it.

    Tables get the published name of each such data set. The requirement is never met in a run that
    replaces data by generated stand-ins.
    """
    from puckbench.published_sources.beside import published_names
    from puckbench.published_sources.registry import all_sources

    chosen = {
        name: data.settings.published
        for name, data in plan.datasets.items()
        if data.settings.published and data in plan.coded
    }
    if not chosen or plan.config.stand_in:
        return None
    names = published_names(all_sources())
    for dataset, name in chosen.items():
        if name not in names:
            where = f"datasets.{dataset}.published"
            raise InputError(f"{where}: no published data set '{name}'{among(name, names)}")
    return {"datasets": chosen}


def _true_spins(plan: Plan) -> list[DataSetPlan]:
    return [data for data in plan.coded if data.has_returns and data.has_true_surface]


def _if(is_met: bool) -> Options | None:
    return {} if is_met else None
