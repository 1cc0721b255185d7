"""The configuration of a run: keys, defaults and meanings.

`puckbench.planning.config_reference` generates the schema for editors and the tables of
`config/README.md` from these models.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    Field,
    PositiveFloat,
    StringConstraints,
    field_validator,
    model_validator,
)

from pointkit.errors import InputError, among, naming
from pointkit.files import read_json
from pointkit.models import Model, checked_model
from pointkit.registry import is_place, trust
from pointkit.yaml_files import read_yaml
from puckbench.codecs.registry import Line
from puckbench.core.renamed_keys import with_new_keys
from puckbench.steps.coding import TimingSettings
from puckbench.steps.evaluate import MeasuringSettings
from puckbench.steps.prepare import PreparationSettings
from puckbench.steps.sample import SamplingSettings
from puckbench.steps.scan import SensorSettings
from puckbench.steps.scene import LoaderSettings
from puckbench.steps.sensing import ResidualSettings
from puckbench.steps.weights import ValidationSettings
from puckbench.tables.odometry_margins import OdometryMargins

Options = dict[str, Any]


def _different(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(set(values)) < len(values):
        raise ValueError("an entry is repeated")
    return values


def _checked_stand_in(cls: type[Model], values: Options) -> Options:
    names = [name for name in cls.model_fields if name != "stand_in"]
    if unknown := [name for name in values if name not in names]:
        raise ValueError(f"unknown key '{unknown[0]}'{among(unknown[0], names)}")
    return values


Distinct = AfterValidator(_different)
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]
"""Name of an entry, such as a data set or codec, which becomes a part of file names."""
RateName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)?$")]
CloudName = Annotated[str, StringConstraints(pattern=r"^[^/]+/[^/]+$")]
"""Names of a data set and of one of its clouds, as ``dataset/cloud``."""
Seed = Annotated[int, Field(ge=0)]
Position = tuple[float, float, float]
Places = Annotated[tuple[str, ...], Distinct]
"""Plug-ins, each as a registered name, ``module:Name`` or ``path/to/file.py:Name``."""


class SceneSource(LoaderSettings):
    """A loader with its options, and which of its scenes are used."""

    seed: Seed | None = Field(None, description="Seed of generated scenes; by default the run's.")
    select: Annotated[tuple[str, ...], Field(min_length=1), Distinct] | None = Field(
        None, description="Names of the scenes to use; by default all."
    )
    limit: int | None = Field(
        None, ge=1, description="Maximum number of scenes; the first by name are used."
    )


class SceneSetConfig(SceneSource):
    """A scene set, from whose scenes clouds are made."""

    stand_in: SceneSource | None = Field(
        None, description="Scene set that replaces this one with `stand_in: true`."
    )


class Sensing(SensorSettings):
    """Configuration keys of both data sets and drives; most describe the virtual sensor."""

    title: str | None = Field(None, description="Title in figures; by default the entry's name.")
    scene_set: str = Field(description="Name of a scene set.")
    make: str
    origin: Position | dict[str, Position] | None = Field(
        None,
        description="Position of the sensor, `[x, y, z]` in m, or a table of positions by scene. "
        "By default the position in the scene, or an unoccupied one near the middle.",
    )
    codecs: Annotated[tuple[str, ...], Field(min_length=1), Distinct] | None = Field(
        None, description="Names of the codecs to run; by default all that can code it."
    )

    @property
    def is_scan(self) -> bool:
        """Whether the clouds are scans by the virtual sensor."""
        return self.make == "scan"


class DataSetConfig(Sensing, SamplingSettings, PreparationSettings, MeasuringSettings):
    """A data set: clouds made from the scenes of a scene set."""

    make: Literal["sample", "scan", "cloud"] = Field(
        description="How a cloud is made from a scene. `sample`: random points on the surface; "
        "`scan`: a scan by the virtual sensor; `cloud`: the captured points."
    )
    seed: Seed | None = Field(
        None, description="Seed of the sampling and of the sensor's errors; by default the run's."
    )
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1), Distinct] | None = Field(
        None,
        description="Several such seeds, each for a cloud of every scene, named `SCENE-SEED`; "
        "deltas, `noise_bits` and `nearest_truth` average over the seeds of a scene first.",
    )
    published: str | None = Field(
        None,
        description="Name of this data set in published numbers, such as `KITTI`: the run then has "
        "the table `published`, and the report a section with the published curves beside its own.",
    )
    truth: bool = Field(
        True,
        description="Measure decoded clouds also against the true surface (`truth_...`) and, for "
        "scans, against the clean scan of the same rays (`clean_...`). Not with `make: cloud`.",
    )
    recovery: bool = Field(
        True,
        description="Compare the geometric primitives of codecs that code surfaces with the labels "
        "of the scenes, if there are labels.",
    )
    metrics: dict[str, Options] = Field(
        {},
        description="Further metrics of this data set alone, with their options, besides those of "
        "the key `metrics`: names (`segmentation: {network: streets}`), or your own functions.",
    )
    stand_in: Options = Field(
        {}, description="Values of keys that replace this data set's with `stand_in: true`."
    )

    _stands_in = field_validator("stand_in")(classmethod(_checked_stand_in))

    @model_validator(mode="after")
    def _has_one_kind_of_seeds(self) -> Self:
        if self.seeds and (self.seed is not None or self.make == "cloud"):
            why = "captured clouds have none" if self.make == "cloud" else "there is a seed too"
            raise ValueError(f"seeds: {why}")
        return self


class DriveConfig(Sensing):
    """Drives of a moving sensor through the scenes of a scene set, and a robot's tasks on them."""

    make: Literal["scan", "cloud"] = Field(
        "scan",
        description="`scan`: the virtual sensor drives through each scene, along the sweep's "
        "`trajectory`; `cloud`: consecutive clouds whose names differ only in a number are "
        "a drive.",
    )
    seeds: tuple[Seed, ...] = Field(
        (1,), min_length=1, description="Seeds of the sensor's errors, one drive for each."
    )
    trajectories: dict[str, Options | str | tuple[tuple[float, ...], ...]] = Field(
        {},
        description="Trajectories by scene, instead of the sweep's `trajectory`: rows of poses, a "
        "file, or a motion by a few numbers, `{duration_s: 10, speed_m_s: 8}`. Only these scenes "
        "are driven through.",
    )
    rates: tuple[RateName, ...] = Field(
        ("1000mm", "500mm", "200mm", "100mm", "50mm", "20mm"),
        min_length=1,
        description="Rates, or budgets: bits per point, or megabits per second, that each codec "
        "meets by its step (`[1bpp, 2bpp]`, `[2mbps]`). A codec that has none of the rates runs "
        "all of its rates.",
    )
    poses: str | None = Field(
        None,
        description="File of poses (`make: cloud`): TUM, whose times cover those of the turns, or "
        "TUM or KITTI with one pose for each turn. KITTI's own are those of a camera: they need "
        "KITTI's `calib.txt` beside them or in its folder. By default those of the scenes or, "
        "without any, those of odometry on the undecoded turns.",
    )
    tasks: dict[str, Options] = Field(
        {"odometry": {}, "gicp_odometry": {}},
        min_length=1,
        description="Tasks with their options: names, or your own functions, `module:function` or "
        "`path/to/file.py:function`.",
    )

    def of_scene(self, scene: str) -> DriveConfig:
        """Return the settings of the drive through one scene.

        If the scene has an entry in `trajectories`, this entry replaces the sweep's trajectory.
        """
        if scene not in self.trajectories:
            return self
        sweep = {"preset": self.sweep} if isinstance(self.sweep, str) else self.sweep
        changed = {**sweep, "trajectory": self.trajectories[scene]}
        return self.model_copy(update={"sweep": changed, "trajectories": {}})


class CodecConfig(Model):
    """Your own codec, a variant of another, or changes to the codec of this name."""

    class_: str | None = Field(
        None,
        alias="class",
        description="Name of the codec of which this is a variant, or your own class: "
        "`module:Class` or `path/to/file.py:Class`.",
    )
    title: str | None = Field(None, description="Title in legends and tables.")
    colour: str | None = Field(
        None, pattern="^#[0-9A-Fa-f]{6}$", description="Colour of its curves, `#rrggbb`."
    )
    marker: str | None = Field(None, description="Marker of its points, as in Matplotlib.")
    line: Line | None = Field(None, description="Style of its lines.")
    training: str | None = Field(
        None, description="Class with the settings of its training, if it has a network."
    )
    options: Options = Field({}, description="Changes to the codec's options.")
    surfaces: bool | None = Field(
        None,
        description="Whether `surfaces` of your own codec returns labelled primitives.",
    )
    rates: tuple[str, ...] | dict[RateName, Options] | None = Field(
        None,
        description="Names of the rates to run (lengths are metric rates); or budgets of bits per "
        "point, which the codec meets by its step or the largest rate below (`[1bpp, 2bpp]`); or a "
        "table of new rates (name to parameters). By default all rates of the codec.",
    )
    metric_rates: tuple[str, ...] | dict[RateName, Options] | None = Field(
        None,
        description="As `rates`, for clouds in metres (`size: metric`): any length such as `3mm`.",
    )

    def changes(self) -> Options:
        """Return the keys that the entry sets, by their names in the configuration file."""
        return self.model_dump(by_alias=True, exclude_unset=True)


class TrainingConfig(ValidationSettings):
    """A training of a learned codec's weights (`snakemake train`)."""

    codec: str = Field(description="Codec whose weights are trained.")
    datasets: tuple[str, ...] = Field(min_length=1, description="Data sets of the training.")
    start: str | None = Field(
        None,
        description="Initial weights: the name of an earlier training or of shipped weights, or a "
        "file; by default random.",
    )
    validate_: tuple[str, ...] = Field(
        (),
        alias="validate",
        description="Data sets for the validation, whose results are in the model card.",
    )
    steps: int | None = Field(None, ge=1, description="Number of steps; by default the codec's.")
    seed: Seed | None = Field(
        None, description="Seed of weights, cubes and noise; by default the run's."
    )
    options: Options = Field({}, description="Further settings of the codec's training.")


class SegmentationTrainingConfig(Model):
    """A training of a network of segmentation (`snakemake train`)."""

    datasets: tuple[str, ...] = Field(
        min_length=1,
        description="Data sets of the training, with labels: scans in metres (`size: metric`) of "
        "generated scenes.",
    )
    validate_: tuple[str, ...] = Field(
        (),
        alias="validate",
        description="Data sets with labels on which the network is measured; the results are in "
        "the model card.",
    )
    steps: int | None = Field(None, ge=1, description="Number of steps; by default 2000.")
    seed: Seed | None = Field(
        None, description="Seed of weights and examples; by default the run's."
    )
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1), Distinct] | None = Field(
        None, description="Several such seeds, each for a network, named `NAME-SEED`."
    )
    options: Options = Field(
        {}, description="Further settings, those of `lidar_segmentation.SegmentationTraining`."
    )


class ErrorModelConfig(Model):
    """An error model of the sensor study."""

    errors: str | None = Field(None, description="Error model; by default the one of this name.")
    error_options: Options = Field({}, description="Changes to the error model's parameters.")


class CaptureConfig(Model):
    """A recording of a real sensor."""

    path: str = Field(description="File of the recording.")
    options: Options = Field({}, description="Options of the measurement of its residuals.")


_MODELS = ("none", "hdl64e", "vlp16", "vlp16_divergence", "vlp16_incidence")


class StudyConfig(ResidualSettings):
    """The sensor's errors measured on a wall and a floor."""

    seed: Seed | None = Field(
        None, description="Seed of the sensor's errors; by default the run's."
    )
    models: dict[Name, ErrorModelConfig | None] = Field(
        {name: ErrorModelConfig() for name in _MODELS},
        min_length=1,
        description="Error models to measure, by their names in tables and figures.",
    )
    captures: dict[Name, CaptureConfig] = Field(
        {},
        description="Recordings of a real sensor to measure too, by name; in figures and tables "
        "they are together the model `real`.",
    )
    distances_m: Annotated[tuple[Annotated[float, Field(lt=30)], ...], Distinct] = Field(
        (1.0, 2.0, 3.0, 4.0, 5.0),
        min_length=1,
        description="Distances of the sensor from the wall, in m; a figure shows scans at 1 and 5.",
    )
    far_m: Annotated[float, Field(ge=30)] | None = Field(
        30.0, description="A further distance, for the effect of beam divergence."
    )

    @field_validator("models")
    @classmethod
    def _real_is_taken(cls, models: dict[str, Any]) -> dict[str, Any]:
        if "real" in models:
            raise ValueError("'real' is the name of the recordings")
        return models


class TimingConfig(TimingSettings):
    """Measurement of times; `timing: exclusive` is short for `timing: {exclusive: true}`."""

    threads: int = Field(1, ge=1, description="Maximum number of threads of a timed call.")
    timeout_s: float | None = Field(
        None,
        gt=0,
        description="Seconds after which a job fails; by default no limit.",
    )


class RateDeltaConfig(Model):
    """Bjontegaard deltas of every codec against an anchor codec."""

    anchor: str | None = Field(
        None, description="Codec with which the others are compared; by default the first."
    )
    metrics: Annotated[tuple[str, ...], Distinct] = Field(
        ("d1_psnr", "d2_psnr"),
        min_length=1,
        description="Columns of the table of metrics that measure quality: PSNRs; lengths (`_m`, "
        "`_mm`), taken as -20 log10; or squared distances, taken as -10 log10.",
    )
    margin_percent: float = Field(
        5.0,
        ge=0,
        description="Largest increase of the bits that counts as none in verdicts: fix it before "
        "you see results.",
    )


class OdometryMarginsConfig(OdometryMargins):
    """Largest differences of odometry on drives that count as none in verdicts."""


class ReportConfig(Model):
    """The report page and its example clouds."""

    title: str = Field(
        "Point-cloud compression on virtual LiDAR scans",
        min_length=1,
        description="Heading of the page.",
    )
    rates: int = Field(
        3,
        ge=1,
        description="Number of rates of each codec whose decoded clouds are shown, evenly spread.",
    )


class ExamplesConfig(Model):
    """Example clouds, which figures and the report show, each `dataset/cloud`."""

    object: CloudName | None = Field(None, description="An object.")
    raw: CloudName | None = Field(None, description="A room.")
    clean: CloudName | None = Field(None, description="The room scanned without noise.")
    noisy: CloudName | None = Field(None, description="The room scanned with noise.")
    spin: CloudName | None = Field(
        None, description="A turn of a sensor, virtual or real (`size: metric`)."
    )

    def clouds_by_kind(self) -> dict[str, str]:
        """Return the named example clouds, as ``dataset/cloud`` by kind of example."""
        clouds: dict[str, str] = self.model_dump(exclude_none=True)
        return clouds


class FiguresConfig(Model):
    """Style of the figures, and the clouds that they show."""

    style: Options = Field({}, description="Changes to the style of all figures.")
    options: dict[str, Options] = Field(
        {}, description="Changes to the style of a figure, by the figure's name."
    )
    own: Places = Field(
        (),
        description="Your own figures, named after their functions: `module:function` or "
        "`path/to/file.py:function`.",
    )
    examples: ExamplesConfig = Field(
        ExamplesConfig(),
        description="Example clouds that figures show, each `dataset/cloud`: `object`, `raw`, "
        "`clean`, `noisy`, `spin`. A figure is drawn if all its clouds are named.",
    )
    stand_in: Options = Field(
        {}, description="Values of keys that replace those of `figures` with `stand_in: true`."
    )
    _stands_in = field_validator("stand_in")(classmethod(_checked_stand_in))


class Config(Model):
    """A checked configuration of a run."""

    results: Annotated[str, StringConstraints(pattern=r"^[\w./ -]+$")] = Field(
        "results", description="Folder of all results."
    )
    seed: Seed = Field(
        2022, description="Seed of all randomness; a data set or scene set may have its own."
    )
    stand_in: bool = Field(
        False,
        description="Use generated data in place of data on disk, for all entries that have a "
        "`stand_in`.",
    )
    strict: bool = Field(
        False,
        description="Stop before anything runs if a scene cannot be used (a damaged mesh, no room "
        "for the sensor). By default it is left out, and listed in the table `left_out`.",
    )
    unused: dict[str, str] = Field(
        {},
        description="Files and other items that `puckbench run` leaves out, and the reasons; for "
        "the table `left_out`.",
    )
    failed: dict[str, str] = Field(
        {},
        description="Failed jobs, whose results and what depends on them are left out, and the "
        "reasons. A job is named like its log, as `coded/DATASET/CLOUD/CODEC`. A run writes them "
        "to `RESULTS/failed.yaml`; a run with this second configuration file makes tables and "
        "report of the rest.",
    )
    scene_sets: dict[Name, SceneSetConfig] = Field(
        description="Scene sets by name: sources of scenes."
    )
    datasets: dict[Name, DataSetConfig] = Field(
        description="Data sets by name, in the order of figures: clouds made from scenes."
    )
    drives: dict[Name, DriveConfig] = Field(
        {}, description="Drives by name: turns of a moving sensor, on which tasks are measured."
    )
    codecs: dict[Name, CodecConfig | None] = Field(
        {"draco": CodecConfig()}, min_length=1, description="Codecs by name."
    )
    tables: Places = Field(
        (),
        description="Your own tables, named after their functions: `module:function` or "
        "`path/to/file.py:function`.",
    )
    metrics: Places = Field(
        (),
        description="Further metrics of every decoded cloud: names (`density`), or your own "
        "functions, `module:function` or `path/to/file.py:function`.",
    )
    train: dict[Name, TrainingConfig] = Field(
        {},
        description="Trainings of learned codecs by the name of the weights, for `snakemake "
        "train`.",
    )
    train_segmentation: dict[Name, SegmentationTrainingConfig] = Field(
        {},
        description="Trainings of networks of segmentation by the name of the weights, for "
        "`snakemake train`.",
    )
    sensor_study: StudyConfig | Literal[False] | None = Field(
        None,
        description="The sensor's errors measured on a wall and a floor: figures 5.1-5.21 and "
        "their tables; `{}` means all defaults.",
    )
    thesis: bool | None = Field(
        None,
        description="Whether to compare the run with the thesis: its claims, published medians and "
        "numbers, and figures 6.1-6.9 under these numbers. By default only with a scene set of its "
        "data (`capod`, `s3dis`, `stanford2d3d`).",
    )
    timing: TimingConfig = Field(TimingConfig(), description="Measurement of times.")
    bd_rate: RateDeltaConfig = Field(
        RateDeltaConfig(),
        description="Codec and metrics for the comparison of codecs by Bjontegaard deltas.",
    )
    odometry_margins: OdometryMarginsConfig = Field(
        OdometryMarginsConfig(),
        description="Largest differences of odometry on drives that count as none: fix them before "
        "you see results.",
    )
    task_margins: dict[str, PositiveFloat] = Field(
        {},
        description="Largest losses of tasks after coding that count as none, by measure and in "
        "its unit, in place of those that the tasks declare (table `perception_bits`): fix them "
        "before you see results.",
    )
    figures: FiguresConfig = Field(
        FiguresConfig(), description="Style of the figures, and the clouds that they show."
    )
    report: ReportConfig = Field(
        ReportConfig(), description="The report page and its example clouds."
    )
    container: str = Field(
        "puckbench.sif",
        pattern=r"^\S+$",
        description="Image in which jobs run with `--software-deployment-method apptainer`: a file "
        "or `docker://...`.",
    )

    @model_validator(mode="before")
    @classmethod
    def _short_timing(cls, values: Any) -> Any:
        if isinstance(values, dict) and values.get("timing") == "exclusive":
            return {**values, "timing": {"exclusive": True}}
        return values

    @property
    def failures_file(self) -> Path:
        """Path of the file to which a run writes the key ``failed`` if jobs fail."""
        return Path(self.results) / "failed.yaml"

    def codec(self, name: str) -> Options:
        """Return the keys that the entry of a codec sets; empty for a codec without changes."""
        return (self.codecs[name] or CodecConfig()).changes()

    def places(self) -> Iterator[str]:
        """Yield the places of code that the configuration names.

        A place is ``module:Name`` or ``file.py:Name``, such as the user's codec or figure.
        """
        yield from filter(is_place, self._plugins())

    def _plugins(self) -> Iterator[str | None]:
        for scene_set in self.scene_sets.values():
            yield from (source.loader for source in (scene_set, scene_set.stand_in) if source)
        for data in self.datasets.values():
            yield from (data.errors, *data.metrics)
        for drive in self.drives.values():
            yield from (drive.errors, *drive.tasks)
        for codec in filter(None, self.codecs.values()):
            yield from (codec.class_, codec.training)
        yield from (training.codec for training in self.train.values())
        yield from (*self.tables, *self.metrics, *self.figures.own)
        if self.sensor_study:
            yield from (model.errors for model in self.sensor_study.models.values() if model)

    def as_json(self) -> Options:
        """Return the configuration with all defaults, as values that JSON can store."""
        values = self.model_dump(mode="json", by_alias=True, exclude_none=True)
        return {**values, "codecs": {name: self.codec(name) for name in self.codecs}}


def checked(config: Mapping[str, Any]) -> Config:
    """Check the keys and values of a configuration, and return it as a `Config`.

    Keys with old names are read as the new ones (`puckbench.core.renamed_keys`). If ``stand_in`` is
    true, generated data first replace data from files (`with_stand_ins`).
    Whether named loaders, codecs, rates and clouds exist is checked later, by
    `puckbench.planning.plan.Plan`.

    Raises
    ------
    InputError
        A key is unknown or there by two names, or a value is not allowed. The message tells the
        key, its value and the allowed values.
    """
    return checked_model(Config, with_stand_ins(with_new_keys(config)))


def trusted(config: Mapping[str, Any]) -> Config:
    """Check a configuration as `checked` does, and permit the import of the code that it names."""
    configuration = checked(config)
    trust(configuration.places())
    return configuration


def with_stand_ins(config: Mapping[str, Any]) -> Options:
    """Return a copy of a configuration that uses generated data if its ``stand_in`` is true.

    The entry ``stand_in`` of a scene set then replaces the whole set. The entry ``stand_in`` of a
    data set, or of the figures, replaces only the keys that it contains. The results folder gets
    the suffix ``_stand_in``. If ``stand_in`` is not true, the copy has the same values.
    """
    changed: Options = copy.deepcopy(dict(config))
    for key in ("stand_in", "strict", "thesis"):
        if changed.get(key) in ("true", "false"):  # Snakemake's --config passes booleans as text
            changed[key] = changed[key] == "true"
    if changed.get("stand_in") is not True:
        return changed
    changed["results"] = f"{changed.get('results', 'results')}_stand_in"
    for scene_set in _mappings(changed.get("scene_sets")):
        stand_in = scene_set.get("stand_in")
        if isinstance(stand_in, dict):
            scene_set.clear()
            scene_set.update(stand_in)
    for entry in (*_mappings(changed.get("datasets")), *_mappings([changed.get("figures")])):
        stand_in = entry.get("stand_in")
        if isinstance(stand_in, dict):
            entry.update(entry.pop("stand_in"))
    return changed


def _mappings(values: Any) -> list[Options]:
    items = values.values() if isinstance(values, dict) else values or ()
    return [value for value in items if isinstance(value, dict)]


def read_config(path: Path) -> Options:
    """Return the content of a YAML or JSON file, without checking its keys.

    Raises
    ------
    InputError
        The file cannot be read, or is not a mapping of keys to values.
    """
    return _read(path, alike=True)


def check_config_files(paths: Iterable[str | Path]) -> None:
    """Raise InputError if a configuration file, which Snakemake has read already, is not valid.

    A file is valid if it is YAML or JSON, YAML 1.1 and 1.2 read all its values alike, and no key is
    there by both its old and its new name.
    A file without any key of puckbench is ignored, since it belongs to a workflow that imports
    puckbench's.
    """
    for path in map(Path, paths):
        values = _read(path, alike=False)
        with naming(path):
            keys = with_new_keys(values)
        if set(Config.model_fields) & set(keys):
            _read(path, alike=True)


def _read(path: Path, alike: bool) -> Options:
    values = read_json(path) if path.suffix.lower() == ".json" else read_yaml(path, alike)
    if not isinstance(values, dict):
        raise InputError(f"{path}: not a mapping of keys to values")
    return values
