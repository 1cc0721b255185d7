"""The configuration of a run: keys, defaults and meanings.

`puckbench.planning.config_reference` generates the schema for editors and the tables of
`config/README.md` from these models.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, StringConstraints, field_validator, model_validator

from puckbench.codecs.facts import Line
from puckbench.core.errors import InputError, among
from puckbench.core.files import read_json
from puckbench.core.models import Model, checked_model
from puckbench.core.registry import is_place, trust
from puckbench.core.yaml_files import read_yaml
from puckbench.geometry.scaling import METRIC

Options = dict[str, Any]


def _different(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(set(values)) < len(values):
        raise ValueError("an entry is repeated")
    return values


def _own_keys(cls: type[Model], values: Options) -> Options:
    names = [name for name in cls.model_fields if name != "stand_in"]
    if unknown := [name for name in values if name not in names]:
        raise ValueError(f"unknown key '{unknown[0]}'{among(unknown[0], names)}")
    return values


Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]
"""Name of a data set, codec and so on; part of file names."""
RateName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_]+$")]
CloudName = Annotated[str, StringConstraints(pattern=r"^[^/]+/[^/]+$")]
"""``dataset/cloud``."""
FailedName = Annotated[str, StringConstraints(pattern=r"^[^/]+/[^/]+(/[^/]+)?$")]
"""``dataset/cloud`` or ``dataset/cloud/codec``."""
Seed = Annotated[int, Field(ge=0)]
Position = tuple[float, float, float]
Places = Annotated[tuple[str, ...], AfterValidator(_different)]
"""Plug-ins: names, ``module:Name`` or ``path/to/file.py:Name``."""


class SceneSource(Model):
    """Where scenes come from, and which of them are used."""

    loader: str = Field(
        description="Name of a loader (`puckbench datasets` lists them with their options), or a "
        "class of your own: `module:Class` or `path/to/file.py:Class`."
    )
    options: Options = Field({}, description="Options of the loader.")
    seed: Seed | None = Field(None, description="Seed of generated scenes; the run's if not given.")
    select: Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(_different)] | None = (
        Field(None, description="Names of the scenes to use; all if not given.")
    )
    limit: int | None = Field(
        None, ge=1, description="Use at most this many scenes, the first by name."
    )


class SceneSetConfig(SceneSource):
    """Scenes: where the geometry comes from."""

    stand_in: SceneSource | None = Field(
        None, description="The scene set used in place of this one with `stand_in: true`."
    )


class DataSetConfig(Model):
    """Clouds made from the scenes of a scene set."""

    title: str | None = Field(None, description="Name in figures; the data set's own if not given.")
    scenes: str = Field(description="Name of a scene set.")
    make: Literal["sample", "scan", "cloud"] = Field(
        description="How a scene becomes a cloud. `sample`: points at random on the surface; "
        "`scan`: a sweep of the virtual sensor; `cloud`: the captured points themselves."
    )
    seed: Seed | None = Field(
        None, description="Seed of the sampling and of the sensor's errors; the run's if not given."
    )
    points: int = Field(500_000, ge=1, description="Points sampled (`make: sample`).")
    sensor: str = Field(
        "vlp16", description="Name of a sensor, or a YAML file with one (`make: scan`)."
    )
    sweep: Options | str = Field(
        {},
        description="Name of a preset (`thesis`, `thesis_room`, `spin`) or changes to the thesis's "
        "sweep (`make: scan`).",
    )
    errors: str = Field("none", description="Error model (`make: scan`).")
    error_options: Options = Field({}, description="Changes to the error model's parameters.")
    height_m: float = Field(
        1.3,
        gt=0,
        description="Height of the sensor above the floor where the scene names no position, in m.",
    )
    origin: Position | dict[str, Position] | None = Field(
        None,
        description="Where the sensor stands, `[x, y, z]` in m, or a table of scenes and places; "
        "where none is named, at the scene's own place, else at a free one near the middle.",
    )
    codecs: Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(_different)] | None = (
        Field(None, description="Names of the codecs that code it; all that can if not given.")
    )
    crop: Literal["clean", "noisy", "none"] = Field(
        "clean",
        description="Crop a scan to the room's box by its `clean` coordinates, by its `noisy` ones "
        "(as the thesis ran), or not at all.",
    )
    size: Annotated[int, Field(ge=2)] | Literal["grid", "metric"] = Field(
        1024,
        description="Clouds are scaled to the cube [0, size - 1]. `grid`: voxels are coded as they "
        "came, on their own grid (`make: cloud`). `metric`: clouds stay in metres, in the frame of "
        "the sensor where one measured them, and rates are lengths (`10mm`).",
    )
    peak: float | None = Field(
        None,
        gt=0,
        description="Peak of the PSNRs, in the unit of the clouds; by default `size - 1`, and 30 m "
        "with `size: metric` (MPEG's 30,000 of 1 mm; papers on KITTI take 59.7).",
    )
    anywhere: bool = Field(
        False,
        description="Scan even where the sensor would stand outside the scene or inside an object, "
        "or pass through walls.",
    )
    truth: bool = Field(
        True,
        description="Measure decoded clouds also against the true surface (`truth_...`) and, for "
        "scans, against the clean scan of the same rays (`clean_...`). Not with `make: cloud`.",
    )
    recovery: bool = Field(
        True,
        description="Compare the geometric primitives of codecs that code surfaces with the labels "
        "of the scenes, where scenes have them.",
    )
    views: int = Field(
        0,
        ge=0,
        description="Width in pixels of the six pictures that are compared (PCC Arena: 1920; at "
        "least 11); 0: none.",
    )
    neighbours: int = Field(
        30, ge=3, description="Neighbouring points from which a normal is estimated."
    )
    stand_in: Options = Field(
        {}, description="Keys of this data set that are others with `stand_in: true`."
    )

    _stands_in = field_validator("stand_in")(classmethod(_own_keys))

    @field_validator("views")
    @classmethod
    def _at_least_a_window(cls, views: int) -> int:
        if 0 < views < 11:
            raise ValueError(f"{views} pixels are too few: 0 for none, or at least 11")
        return views

    @property
    def is_metric(self) -> bool:
        return self.size == METRIC

    @property
    def is_scan(self) -> bool:
        return self.make == "scan"

    def origin_in(self, scene: str) -> Position | None:
        return self.origin.get(scene) if isinstance(self.origin, dict) else self.origin

    @property
    def has_truth(self) -> bool:
        return self.truth and self.make != "cloud"


class CodecConfig(Model):
    """Changes to a codec of that name, or a codec of one's own."""

    class_: str | None = Field(
        None,
        alias="class",
        description="Codec that it is a variant of, by name, or the class of your own: "
        "`module:Class` or `path/to/file.py:Class`.",
    )
    title: str | None = Field(None, description="Title in legends and tables.")
    colour: str | None = Field(
        None, pattern="^#[0-9A-Fa-f]{6}$", description="Colour of its curves, `#rrggbb`."
    )
    marker: str | None = Field(None, description="Marker of its points, one of Matplotlib's.")
    line: Line | None = Field(None, description="Style of its lines.")
    training: str | None = Field(
        None, description="Class of the settings of its training, if it has a network."
    )
    options: Options = Field({}, description="Changes to the codec's options.")
    surfaces: bool | None = Field(
        None,
        description="Whether `_decode_mesh` of a codec of your own gives labelled primitives.",
    )
    rates: tuple[str, ...] | dict[RateName, Options] | None = Field(
        None,
        description="Names of the rates to run, or a table of new ones (name to parameters); all "
        "of the codec's if not given.",
    )
    metric_rates: tuple[str, ...] | dict[RateName, Options] | None = Field(
        None, description="As `rates`, for clouds in metres (`size: metric`): names such as `10mm`."
    )

    def changes(self) -> Options:
        return self.model_dump(by_alias=True, exclude_unset=True)


class TrainingConfig(Model):
    """Weights of a learned codec to train (`snakemake train`)."""

    codec: str = Field(description="Whose weights.")
    datasets: tuple[str, ...] = Field(min_length=1, description="Data sets to learn from.")
    start: str | None = Field(
        None,
        description="Weights to start from: those of a training above it, a shipped set's name, "
        "or a file; random if not given.",
    )
    validate_: tuple[str, ...] = Field(
        (),
        alias="validate",
        description="Data sets on whose clouds the weights are measured, for the model card.",
    )
    validate_every: int = Field(
        0, ge=0, description="Steps between two measurements; 0: measure at the end alone."
    )
    steps: int | None = Field(None, ge=1, description="Steps; the codec's if not given.")
    seed: Seed | None = Field(
        None, description="Seed of weights, cubes and noise; the run's if not given."
    )
    options: Options = Field({}, description="Further settings of the codec's training.")


class ErrorModelConfig(Model):
    """An error model of the sensor study."""

    errors: str | None = Field(None, description="Error model; the name itself if not given.")
    error_options: Options = Field({}, description="Changes to the error model's parameters.")


class CaptureConfig(Model):
    """A recording of a real sensor."""

    path: str = Field(description="File of the recording.")
    options: Options = Field({}, description="Options of its residuals.")


_MODELS = ("none", "hdl64e", "vlp16", "vlp16_divergence", "vlp16_incidence")


class StudyConfig(Model):
    """The sensor's errors measured on a wall and a floor (thesis chapter 5, Procedure 1)."""

    seed: Seed | None = Field(
        None, description="Seed of the sensor's errors; the run's if not given."
    )
    models: dict[Name, ErrorModelConfig | None] = Field(
        {name: ErrorModelConfig() for name in _MODELS},
        min_length=1,
        description="Error models to measure, by the name that tables and figures give them.",
    )
    captures: dict[Name, CaptureConfig] = Field(
        {},
        description="Recordings of a real sensor to measure beside them, by name; in figures and "
        "tables all of them are the model `real`.",
    )
    distances_m: Annotated[
        tuple[Annotated[float, Field(lt=30)], ...], AfterValidator(_different)
    ] = Field(
        (1.0, 2.0, 3.0, 4.0, 5.0),
        min_length=1,
        description="Distances of the sensor from the wall, in m; scans are drawn from 1 and 5.",
    )
    far_m: Annotated[float, Field(ge=30)] | None = Field(
        30.0, description="One more distance, for the effect of beam divergence (Figure 5.19)."
    )
    runs: int = Field(3, ge=1, description="Scans from each distance.")
    rows: int = Field(
        10_000, ge=1, description="Residuals of each scan that are kept, chosen at random."
    )
    refit: bool = Field(
        False, description="Least-squares planes instead of RANSAC's own, which the thesis used."
    )

    @field_validator("models")
    @classmethod
    def _real_is_taken(cls, models: dict[str, Any]) -> dict[str, Any]:
        if "real" in models:
            raise ValueError("'real' is the name of the recordings")
        return models


class TimingConfig(Model):
    """How times are taken; `timing: exclusive` is short for `timing: {exclusive: true}`."""

    repeats: int = Field(
        3, ge=1, description="Repetitions of each encoding and decoding; the median time counts."
    )
    exclusive: bool = Field(
        False, description="Whether nothing else runs while a job with timed calls does."
    )
    threads: int = Field(1, ge=1, description="Threads that a timed call may use.")
    timeout_s: float | None = Field(
        None,
        gt=0,
        description="Seconds after which a job fails; no limit if not given.",
    )


class RateDeltaConfig(Model):
    """The Bjontegaard deltas of every codec against one of them."""

    anchor: str | None = Field(
        None, description="Codec that the others are compared with; the first one if not given."
    )
    metrics: Annotated[tuple[str, ...], AfterValidator(_different)] = Field(
        ("d1_psnr", "d2_psnr"),
        min_length=1,
        description="Columns of the table of metrics that measure quality: PSNRs, or squared "
        "distortions, taken as -10 log10.",
    )
    resamples: int = Field(2000, ge=100, description="Draws of the bootstrap over clouds.")


class ReportConfig(Model):
    """What the report page shows of the example clouds."""

    title: str = Field(
        "Point-cloud compression on virtual LiDAR scans",
        min_length=1,
        description="Heading of the page.",
    )
    rates: int = Field(
        3, ge=1, description="Rates of each codec whose decoded clouds are shown, evenly spread."
    )
    points: int = Field(20_000, ge=100, description="Points of a cloud in the viewer, at most.")
    most_mb: float = Field(
        8.0,
        gt=0,
        description="Megabytes that all clouds take in the page, at most; where they are many, "
        "they have fewer points.",
    )


class ExamplesConfig(Model):
    """Example clouds of Figures 6.1 to 6.3, each `dataset/cloud`."""

    object: CloudName | None = Field(None, description="An object.")
    raw: CloudName | None = Field(None, description="A room.")
    clean: CloudName | None = Field(None, description="The room scanned without noise.")
    noisy: CloudName | None = Field(None, description="The room scanned with noise.")
    spin: CloudName | None = Field(
        None, description="A turn of a sensor, virtual or real (`size: metric`)."
    )

    def given(self) -> dict[str, str]:
        clouds: dict[str, str] = self.model_dump(exclude_none=True)
        return clouds


class FiguresConfig(Model):
    """How figures look, and which clouds they show."""

    style: Options = Field({}, description="Changes to the look of all figures.")
    options: dict[str, Options] = Field(
        {}, description="Changes to the look of one figure, by its name."
    )
    own: Places = Field(
        (),
        description="Figures of your own: functions, `module:function` or "
        "`path/to/file.py:function`, by whose names they are called.",
    )
    examples: ExamplesConfig = Field(
        ExamplesConfig(),
        description="Example clouds of figures 6.1-6.3, each `dataset/cloud`: `object`, `raw`, "
        "`clean`, `noisy`, `spin`; a figure is drawn when all that it shows are named.",
    )
    stand_in: Options = Field(
        {}, description="Keys of `figures` that are others with `stand_in: true`."
    )
    _stands_in = field_validator("stand_in")(classmethod(_own_keys))


class Config(Model):
    """A checked configuration of a run."""

    results: Annotated[str, StringConstraints(pattern=r"^[\w./ -]+$")] = Field(
        "results", description="Folder of everything that is made."
    )
    seed: Seed = Field(
        2022, description="Seed of all randomness; a data set or scene set may have its own."
    )
    stand_in: bool = Field(
        False,
        description="Use the generated data that stand in for those on disk, wherever any are "
        "named.",
    )
    strict: bool = Field(
        False,
        description="Stop before anything runs where a scene cannot be used (a damaged mesh, no "
        "room for the sensor); else it is left out and named in the table `left_out`.",
    )
    unused: dict[str, str] = Field(
        {},
        description="What `puckbench run` leaves out, such as unusable files, and why: for "
        "the table `left_out`.",
    )
    failed: dict[FailedName, str] = Field(
        {},
        description="Clouds (`dataset/cloud`) and curves (`dataset/cloud/codec`) that are left out "
        "because their jobs failed, and why. A run writes them to `RESULTS/failed.yaml`; with this "
        "second configuration file, tables and report are made of the rest.",
    )
    scenes: dict[Name, SceneSetConfig] = Field(
        description="Scene sets by name: where the geometry comes from."
    )
    datasets: dict[Name, DataSetConfig] = Field(
        description="Data sets by name: clouds made from a scene set; figures keep this order."
    )
    codecs: dict[Name, CodecConfig | None] = Field(
        {"draco": CodecConfig()}, min_length=1, description="Codecs by name."
    )
    tables: Places = Field(
        (),
        description="Tables of your own: functions, `module:function` or "
        "`path/to/file.py:function`, by whose names they are called.",
    )
    metrics: Places = Field(
        (),
        description="Further metrics of every decoded cloud: their names (`density`), or functions "
        "of your own, `module:function` or `path/to/file.py:function`.",
    )
    train: dict[Name, TrainingConfig] = Field(
        {}, description="Weights of learned codecs to train, by name: `snakemake train`."
    )
    sensor_study: StudyConfig | Literal[False] | None = Field(
        None,
        description="The sensor's errors measured on a wall and a floor: figures 5.1-5.21 and "
        "their tables; `{}` takes all defaults.",
    )
    timing: TimingConfig = Field(TimingConfig(), description="How times are taken.")
    bd_rate: RateDeltaConfig = Field(
        RateDeltaConfig(),
        description="Against which codec, and in what, the others are compared.",
    )
    figures: FiguresConfig = Field(FiguresConfig(), description="How figures look.")
    report: ReportConfig = Field(
        ReportConfig(), description="What the report page shows of the example clouds."
    )
    container: str = Field(
        "puckbench.sif",
        pattern=r"^\S+$",
        description="Image that jobs run in with `--software-deployment-method apptainer`: a file "
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
        """Return the file with `failed`, which a run writes if jobs for clouds or curves fail."""
        return Path(self.results) / "failed.yaml"

    def codec(self, name: str) -> Options:
        return (self.codecs[name] or CodecConfig()).changes()

    def places(self) -> Iterator[str]:
        """Yield the names of code (``module:Name``, ``file.py:Name``) in the configuration."""
        yield from filter(is_place, self._plugins())

    def _plugins(self) -> Iterator[str | None]:
        for scenes in self.scenes.values():
            yield from (source.loader for source in (scenes, scenes.stand_in) if source)
        yield from (data.errors for data in self.datasets.values())
        for codec in filter(None, self.codecs.values()):
            yield from (codec.class_, codec.training)
        yield from (*self.tables, *self.metrics, *self.figures.own)
        if self.sensor_study:
            yield from (model.errors for model in self.sensor_study.models.values() if model)

    def as_json(self) -> Options:
        values = self.model_dump(mode="json", by_alias=True, exclude_none=True)
        return {**values, "codecs": {name: self.codec(name) for name in self.codecs}}


def checked(config: Mapping[str, Any]) -> Config:
    """Check a configuration, after replacing data by stand-ins if it requests them.

    Names of loaders, codecs, rates and clouds are checked by `puckbench.planning.plan`. Raises
    InputError with the key, its value and the allowed values.
    """
    return checked_model(Config, with_stand_ins(config))


def trusted(config: Mapping[str, Any]) -> Config:
    """Check the user's configuration, and trust the code that it names."""
    configuration = checked(config)
    trust(configuration.places())
    return configuration


def with_stand_ins(config: Mapping[str, Any]) -> Options:
    """Replace data from files by generated data if `stand_in` is true.

    The `stand_in` of a scene set replaces it; that of a data set or of the figures changes some
    keys. Results go to another folder.
    """
    changed: Options = copy.deepcopy(dict(config))
    for key in ("stand_in", "strict"):
        if changed.get(key) in ("true", "false"):  # as Snakemake's --config hands it over
            changed[key] = changed[key] == "true"
    if changed.get("stand_in") is not True:
        return changed
    changed["results"] = f"{changed.get('results', 'results')}_stand_in"
    for scenes in _mappings(changed.get("scenes")):
        stand_in = scenes.get("stand_in")
        if isinstance(stand_in, dict):
            scenes.clear()
            scenes.update(stand_in)
    for entry in (*_mappings(changed.get("datasets")), *_mappings([changed.get("figures")])):
        stand_in = entry.get("stand_in")
        if isinstance(stand_in, dict):
            entry.update(entry.pop("stand_in"))
    return changed


def _mappings(values: Any) -> list[Options]:
    items = values.values() if isinstance(values, dict) else values or ()
    return [value for value in items if isinstance(value, dict)]


def read_config(path: Path) -> Options:
    """Read a YAML or JSON file without checking its keys."""
    return _read(path, alike=True)


def check_config_files(paths: Iterable[str | Path]) -> None:
    """Raise InputError if a file that Snakemake has read is invalid.

    Files without keys of puckbench belong to a workflow that imports this one, and are ignored.
    """
    for path in map(Path, paths):
        if set(Config.model_fields) & set(_read(path, alike=False)):
            _read(path, alike=True)


def _read(path: Path, alike: bool) -> Options:
    values = read_json(path) if path.suffix.lower() == ".json" else read_yaml(path, alike)
    if not isinstance(values, dict):
        raise InputError(f"{path}: not a mapping of keys to values")
    return values
