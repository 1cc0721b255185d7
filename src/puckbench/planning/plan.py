from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, get_args

from pointkit.errors import InputError, among, closest, naming
from pointkit.files import sha256
from pointkit.geometry.cloud import CoordinateFrame
from pointkit.lidar.sensors import load_sensor
from puckbench.codecs import registry as codecs
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import skip_anywhere
from puckbench.codecs.learned import require_networks
from puckbench.codecs.rates import budgets_among, is_length, rates_of
from puckbench.codecs.registry import open_training
from puckbench.geometry.attributes import attribute_of
from puckbench.geometry.scaling import GRID, METRIC
from puckbench.metrics.metric_registry import METRICS
from puckbench.metrics.task_registry import TASKS
from puckbench.planning.codec_files import files_digest, files_of_codec, program_digests
from puckbench.planning.config import (
    Config,
    DataSetConfig,
    DriveConfig,
    Options,
    SceneSetConfig,
    SegmentationTrainingConfig,
    Sensing,
    StudyConfig,
    TrainingConfig,
)
from puckbench.planning.failures import described
from puckbench.planning.file_digests import file_digests
from puckbench.planning.memory import Memory
from puckbench.planning.scene_checks import (
    SceneCheck,
    printable,
    read_checks,
    refuse_paths,
    scene_faults,
)
from puckbench.scene_sets.base import SceneSet
from puckbench.scene_sets.recordings import recording_files
from puckbench.scene_sets.registry import open_scene_set
from puckbench.steps.coding import TimingSettings
from puckbench.steps.scan import SensorSettings
from puckbench.steps.segmentation_weights import open_segmentation_training
from puckbench.steps.sensing import SensingCode, code_of_scan
from virtual_lidar import open_error_model, open_sweep
from virtual_lidar.scenes.calibration import CALIBRATIONS

_MAKING = ("samples", "scans", "clouds")
"""First parts of the names of the jobs that make a cloud from a scene."""
_NOWHERE = {"dataset": "", "scene": ""}


@dataclass(frozen=True)
class SceneSetPlan:
    """An opened scene set, with the names of the scenes that a run uses.

    Parameters
    ----------
    name
        Name of the scene set in the configuration.
    loader, options, seed
        Name of the loader that reads or generates the scenes, its options, and the seed of
        generated scenes.
    scenes
        The opened set, which loads a scene by its name.
    chosen
        Names of the scenes that the configuration selects.
    """

    name: str
    loader: str
    seed: int
    options: dict[str, Any]
    scenes: SceneSet
    chosen: tuple[str, ...]

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of all scenes of the set, also of those that the run does not use."""
        return frozenset(self.scenes.names())

    def files(self, scene: str) -> list[str]:
        """Return the paths of the files from which a scene is read."""
        return [str(path) for path in self.scenes.files(scene)]

    def options_of(self, scene: str) -> dict[str, Any]:
        """Return the loader's options for one scene, narrowed to this scene if possible."""
        narrowed = self.scenes.options_of(scene)
        return self.options if narrowed is None else narrowed


@dataclass(frozen=True)
class DataSetPlan:
    """The clouds that a run makes for one data set of the configuration.

    Parameters
    ----------
    name
        Name of the data set.
    scene_set
        Name of the scene set from which the clouds are made.
    sources
        For each cloud's name, the name of its scene and the seed with which it is made.
    points
        Estimated number of points of a cloud, from which time and memory are estimated.
    settings
        The data set's entry in the configuration.
    has_returns
        Whether the clouds consist of the returns of a spinning sensor.
    has_packets
        Whether these returns come from recorded data packets.
    """

    name: str
    scene_set: str
    sources: Mapping[str, tuple[str, int]]
    points: int
    settings: DataSetConfig
    has_returns: bool = False
    has_packets: bool = False

    @property
    def clouds(self) -> tuple[str, ...]:
        """Names of the clouds."""
        return tuple(self.sources)

    def source_of(self, cloud: str) -> tuple[str, int]:
        """Return the name of a cloud's scene, and the seed with which the cloud is made.

        For an excluded cloud, return the cloud's name and 0: its job then fails with a message.
        """
        return self.sources.get(cloud, (cloud, 0))

    @property
    def used_scenes(self) -> tuple[str, ...]:
        """Names of the scenes from which clouds are made."""
        return tuple(dict.fromkeys(scene for scene, _ in self.sources.values()))

    @property
    def frame(self) -> CoordinateFrame:
        """Coordinate frame of the clouds: ``metric`` for metres, ``scaled`` for a cube's grid."""
        return "metric" if self.settings.is_metric else "scaled"

    @property
    def has_truth(self) -> bool:
        """Whether decoded clouds are also compared with the true surface or the true points."""
        return self.settings.truth and self.settings.make != "cloud"

    @property
    def has_true_surface(self) -> bool:
        """Whether the true surface is available in the clouds' coordinate frame.

        For a moving or tilted sensor, only true points are available.
        """
        if not self.has_truth or not self.has_returns:
            return self.has_truth
        return open_sweep(self.settings.sweep).is_level_and_still

    @property
    def is_scanned_from_truth(self) -> bool:
        """Whether the clouds are scans of a surface with which decoded clouds are compared."""
        return self.has_truth and self.settings.is_scan


@dataclass(frozen=True)
class StudyPlan:
    """The checked sensor study, which measures the sensor's errors on a wall and a floor.

    Parameters
    ----------
    settings
        The entry ``sensor_study`` of the configuration.
    models
        For each name in tables and figures, the error model and the changes to its parameters.
    captures
        For each recording's name, its path and the options of its measurement.
    seed
        Seed of the sensor's errors.
    """

    settings: StudyConfig
    models: dict[str, tuple[str, dict[str, Any]]]
    captures: dict[str, tuple[str, dict[str, Any]]]
    seed: int

    @property
    def all_distances_m(self) -> tuple[float, ...]:
        """Distances of the sensor from the wall, in m, with the far one at the end."""
        far_m = self.settings.far_m
        return (*self.settings.distances_m, *([] if far_m is None else [far_m]))

    @property
    def shown_m(self) -> tuple[float, ...]:
        """Distances, in m, of the scans that a figure shows."""
        return tuple(distance for distance in (1.0, 5.0) if distance in self.settings.distances_m)


@dataclass(frozen=True)
class TrainingPlan:
    """The training of a learned codec's weights, and their validation.

    Parameters
    ----------
    codec, entry
        Name of the codec, and its entry in the configuration.
    clouds, validate
        Clouds of the training and of the validation, as pairs (data set, cloud).
    start
        Path of the file of initial weights; None starts with random weights.
    settings
        Settings of the codec's training, with the seed.
    """

    codec: str
    entry: dict[str, Any]
    clouds: tuple[tuple[str, str], ...]
    validate: tuple[tuple[str, str], ...]
    start: str | None
    settings: dict[str, Any]


@dataclass(frozen=True)
class SegmentationPlan:
    """The training of a network of segmentation, and its validation.

    Parameters
    ----------
    clouds, validate
        Clouds of the training and of the validation, as pairs (data set, cloud).
    settings
        Settings of the training, with the seed.
    """

    clouds: tuple[tuple[str, str], ...]
    validate: tuple[tuple[str, str], ...]
    settings: dict[str, Any]


class Plan:
    """What a run makes: the clouds, codecs, trainings and drives of a configuration.

    Jobs that failed in the last run (``failed`` in the configuration) are excluded, with all that
    depends on them.

    Parameters
    ----------
    config
        The checked configuration.
    check_scenes
        Whether to read the scenes first, and to exclude those that cannot be used.

    Raises
    ------
    InputError
        The configuration names a loader, scene set, scene, codec or metric that does not exist;
        nothing is left to run; or the configuration sets ``strict``, and a scene cannot be used.
    """

    def __init__(self, config: Config, check_scenes: bool = False) -> None:
        self.config, self._check_scenes = config, check_scenes
        self.memory = Memory(self.results)
        self.scene_sets = {
            name: open_scenes(name, value, config.seed) for name, value in config.scene_sets.items()
        }
        self._scan_codes: dict[str, SensingCode] = {}
        self.left_out: dict[str, dict[str, str]] = {}
        """For each data set, the names of the excluded scenes, with the reasons."""
        self.datasets = self._datasets()
        self.codecs = {name: codecs.entry(name, config.codec(name)) for name in config.codecs}
        if config.failed and not config.drives:  # which may use any codec
            coded = {codec for _, _, codec in self.curves}
            self.codecs = {name: entry for name, entry in self.codecs.items() if name in coded}
            self.opened = {name: codec for name, codec in self.opened.items() if name in coded}
        self.weights = {name: _weights(name, config.codec(name)) for name in self.codecs}
        self.trainings: dict[str, TrainingPlan] = {}
        for name, value in config.train.items():
            if not self._lacks_start(name, value):
                self.trainings[name] = self._training(name, value)
        self.segmentations = dict(self._segmentations())
        self._check_metrics()
        self.drives = _runnable(config.drives)
        self.study = self._study(config.sensor_study) if config.sensor_study else None
        if not (self.datasets or self.study or self.drives or config.failed):
            raise InputError("the configuration has no data set, no drive and no sensor study")
        if config.strict and check_scenes:
            for row in self._rates_left_out():
                raise InputError(f"{row['file']}: {row['reason']}")

    def _check_metrics(self) -> None:
        with naming("metrics"):
            for name in self.config.metrics:
                if name not in METRICS:  # importing puckbench's own metrics takes long
                    METRICS.get(name)
        for dataset, data in self.config.datasets.items():
            with naming(f"datasets.{dataset}.metrics"):
                for name, options in data.metrics.items():
                    METRICS.get(name).check(options)

    def metrics_of(self, dataset: str) -> dict[str, Options]:
        """Return the options of the further metrics of a data set's decoded clouds, by name.

        Metrics that need a package that is not installed are left out.
        """
        of_all: dict[str, Options] = {name: {} for name in self.config.metrics}
        metrics = of_all | dict(self.config.datasets[dataset].metrics)
        return {name: options for name, options in metrics.items() if not METRICS.get(name).missing}

    def files_of_metrics(self, dataset: str) -> list[Path]:
        """Return the files, such as weights, that the further metrics of a data set read."""
        metrics = self.metrics_of(dataset).items()
        return [path for name, options in metrics for path in METRICS.get(name).files(**options)]

    def _datasets(self) -> dict[str, DataSetPlan]:
        datasets = {name: self._dataset(name, data) for name, data in self.config.datasets.items()}
        usable = {name: data for name, data in datasets.items() if data.clouds}
        if datasets and not usable and self.left_out:
            name, faults = next(iter(self.left_out.items()))
            raise _unusable(name, faults)
        return usable

    def left_out_rows(self) -> tuple[dict[str, str], ...]:
        """Return the rows of the table ``left_out``, which lists all that the run excludes.

        Each row has the columns ``dataset`` and ``scene`` (empty if the reason is not a scene's),
        ``file`` (the file or other item) and ``reason``.
        """
        named = [
            {"dataset": "", "scene": "", "file": file, "reason": why}
            for file, why in self.config.unused.items()
        ]
        return (
            *named,
            *self._scenes_left_out(),
            *self._attributes_left_out(),
            *self._rates_left_out(),
            *self._codecs_left_out(),
            *self._failures_left_out(),
            *self._tasks_left_out(),
        )

    def _scenes_left_out(self) -> Iterator[dict[str, str]]:
        for dataset, faults in self.left_out.items():
            scenes = self.scene_sets[self.config.datasets[dataset].scene_set].scenes
            for scene, fault in faults.items():
                file = _file_of(dataset, scenes, scene)
                reason = fault.removeprefix(f"{file}: ")
                yield {"dataset": dataset, "scene": scene, "file": file, "reason": reason}

    def _attributes_left_out(self) -> Iterator[dict[str, str]]:
        for data in self.datasets.values():
            if not self.scene_sets[data.scene_set].scenes.read_first:
                continue
            checks, reasons = list(self._checks(data.name, data.used_scenes).values()), []
            coded_by: dict[str, list[str]] = {}
            if count := sum(check.dropped_points for check in checks):
                reasons.append(f"{count:,} points that are missing returns or not finite")
            for name in dict.fromkeys(name for check in checks for name in check.attributes):
                coded_by.setdefault(self._coders_of(attribute_of(name)), []).append(name)
            for coders, names in coded_by.items():
                why = f"coded by {coders} only" if coders else "codecs code coordinates only"
                reasons.append(f"{', '.join(names)}: {why}")
            if data.frame == "metric" and any(check.is_shifted for check in checks):
                reasons.append(
                    "their place: coded clouds are shifted to the origin, and `puckbench decode "
                    f"--like {self.results}/clouds/{data.name}/CLOUD.ply` shifts decoded ones back"
                )
            for reason in reasons:
                yield {"dataset": data.name, "scene": "", "file": data.name, "reason": reason}

    def has_failed(self, *names: str) -> bool:
        """Return whether a job failed in the last run.

        `names` are the parts of the path of the job's log, such as ``coded``, data set, cloud and
        codec.
        """
        return "/".join(names) in self.config.failed

    @property
    def examples(self) -> dict[str, str]:
        """Example clouds of figures and report: for each kind of example, ``dataset/cloud``."""
        shown = self.config.figures.examples.clouds_by_kind()
        if not self.config.failed:
            return shown
        clouds = {"/".join(cloud) for cloud in self.clouds}
        return {kind: name for kind, name in shown.items() if name in clouds}

    @property
    def anchor(self) -> str:
        """Name of the codec against which Bjontegaard deltas compare the other codecs."""
        anchor = self.config.bd_rate.anchor
        if anchor is None or (anchor in self.config.codecs and anchor not in self.codecs):
            return next(iter(self.codecs), "")
        return anchor

    def _coders_of(self, attribute: str) -> str:
        return ", ".join(n for n in self.codecs if attribute in self.opened[n].attributes)

    def _codecs_left_out(self) -> Iterator[dict[str, str]]:
        for codec in self.codecs:
            reasons: dict[str, list[str]] = {}
            for data in self.datasets.values():
                if self._is_requested(codec, data) and (reason := self._why_not(codec, data)):
                    reasons.setdefault(reason, []).append(data.name)
            for reason, names in reasons.items():
                where = f"does not code {', '.join(names)}: {reason}"
                yield {"dataset": "", "scene": "", "file": f"codec {codec}", "reason": where}

    def _failures_left_out(self) -> Iterator[dict[str, str]]:
        for job, reason in self.config.failed.items():
            _, dataset, cloud, *_ = (*job.split("/"), "", "")
            is_cloud = dataset in self.config.datasets
            place = {"dataset": dataset, "scene": cloud} if is_cloud else _NOWHERE
            yield {**place, "file": described(job), "reason": reason}

    def _tasks_left_out(self) -> Iterator[dict[str, str]]:
        for name in dict.fromkeys(t for drive in self.config.drives.values() for t in drive.tasks):
            if missing := TASKS.get(name).missing:
                reason = (
                    f"{', '.join(missing)} is not installed (pip install 'puckbench[odometry]')"
                )
                yield {"dataset": "", "scene": "", "file": f"task {name}", "reason": reason}

    def _rates_left_out(self) -> Iterator[dict[str, str]]:
        for (dataset, cloud, codec), rates in self.too_wide.items():
            kind = self._kind(self.datasets[dataset], self.extents[dataset][cloud])
            why = skip_anywhere(self.opened[codec], kind, rates[0])
            reason = f"codec {codec} at {', '.join(rates)}: {why}"
            scenes = self.scene_sets[self.datasets[dataset].scene_set].scenes
            file = _file_of(dataset, scenes, cloud)
            yield {"dataset": dataset, "scene": cloud, "file": file, "reason": reason}

    @cached_property
    def extents(self) -> dict[str, dict[str, float]]:
        """Longest side of the bounding box, in m, of each cloud in metres, by data set and cloud.

        A cloud that was not measured before the run is missing.
        """
        return {
            name: {
                cloud: extent
                for cloud, (scene, _) in data.sources.items()
                if scene in checks and (extent := checks[scene].extent_m) is not None
            }
            for name, data in self.datasets.items()
            if data.frame == "metric"
            for checks in [self._checks(name, data.used_scenes)]
        }

    @cached_property
    def too_wide(self) -> dict[tuple[str, str, str], tuple[str, ...]]:
        """Names of the rates that a codec skips for a wide cloud, by (data set, cloud, codec)."""
        rates_by_curve = {
            (dataset, cloud, codec): self._too_fine(codec, dataset, extent)
            for dataset, sides in self.extents.items()
            for cloud, extent in sides.items()
            for codec in self.codecs
            if self.codes(codec, dataset)
        }
        return {cell: rates for cell, rates in rates_by_curve.items() if rates}

    def _too_fine(self, codec: str, dataset: str, extent: float) -> tuple[str, ...]:
        opened, kind = self.opened[codec], self._kind(self.datasets[dataset], extent)
        return tuple(r for r in self.rates(codec, "metric") if skip_anywhere(opened, kind, r))

    def curve_rates(self, dataset: str, cloud: str, codec: str) -> tuple[str, ...]:
        """Return the names of the rates at which a codec encodes a cloud.

        There are none if the encoding or the measurement of this cloud failed in the last run.
        """
        if any(self.has_failed(kind, dataset, cloud, codec) for kind in ("coded", "metrics")):
            return ()
        rates = self.rates(codec, self.datasets[dataset].frame)
        without = self.too_wide.get((dataset, cloud, codec), ())
        return tuple(rate for rate in rates if rate not in without) if without else rates

    def shown_rates(self, dataset: str, cloud: str, codec: str) -> tuple[str, ...]:
        """Return the names of the rates at which the report shows a decoded example cloud."""
        rates = self.rates(codec, self.datasets[dataset].frame)
        coded = self.curve_rates(dataset, cloud, codec)
        return tuple(rate for rate in spread_out(rates, self.config.report.rates) if rate in coded)

    @property
    def results(self) -> Path:
        """Path of the results folder."""
        return Path(self.config.results)

    @cached_property
    def opened(self) -> dict[str, Codec]:
        """Codecs of the run by name, with their options and rates, but without loaded weights."""
        return {name: codecs.open_codec(name, self.config.codec(name)) for name in self.codecs}

    @cached_property
    def clouds(self) -> tuple[tuple[str, str], ...]:
        """All clouds of the run, as pairs (data set, cloud)."""
        return tuple((data.name, cloud) for data in self.datasets.values() for cloud in data.clouds)

    @cached_property
    def scanned(self) -> tuple[tuple[str, str], ...]:
        """Scans whose distance from the true surface is measured before any coding.

        Each is a pair (data set, cloud).
        """
        datasets = {name for name, data in self.datasets.items() if data.is_scanned_from_truth}
        return tuple(
            cloud
            for cloud in self.clouds
            if cloud[0] in datasets and not self.has_failed("scan_errors", *cloud)
        )

    @cached_property
    def recovered(self) -> tuple[tuple[str, str, str], ...]:
        """Curves whose decoded primitives are compared with the labels of the scenes.

        Each is a triple (data set, cloud, codec), as in `curves`.
        """
        config, datasets = self.config, self.datasets.values()
        coders = {n for n in self.codecs if codecs.codes_surfaces(n, config.codec(n))}
        labelled = {
            data.name
            for data in datasets
            if data.settings.recovery
            and data.frame == "scaled"
            and data.settings.make != "cloud"
            and self.scene_sets[data.scene_set].scenes.primitives
        }
        curves = (c for c in self.curves if c[0] in labelled and c[2] in coders)
        return tuple(curve for curve in curves if not self.has_failed("recovery", *curve))

    @cached_property
    def curves(self) -> tuple[tuple[str, str, str], ...]:
        """Rate-distortion curves of the run, as triples (data set, cloud, codec)."""
        return tuple(
            (dataset, cloud, codec)
            for dataset, cloud in self.clouds
            for codec in self.codecs
            if self.codes(codec, dataset) and self.curve_rates(dataset, cloud, codec)
        )

    def rows(
        self, kind: str, codec: str | None = None, frame: CoordinateFrame | None = None
    ) -> tuple[str, ...]:
        """Return the files with rows of results, relative to the results folder.

        Parameters
        ----------
        kind
            ``metrics`` for measurements of decoded clouds, ``recovery`` for decoded primitives.
        codec
            Name of the codec; by default, the files of all codecs are returned.
        frame
            Coordinate frame of the clouds; by default, those of both frames are returned.
        """
        curves = self.recovered if kind == "recovery" else self.curves
        return tuple(
            f"{kind}/{'/'.join(curve)}.parquet"
            for curve in curves
            if codec in (None, curve[2]) and frame in (None, self.datasets[curve[0]].frame)
        )

    def artefacts(self) -> list[str]:
        """Return the files with streams and rows of results, relative to the results folder."""
        coded = [f"coded/{'/'.join(curve)}.zip" for curve in self.curves]
        return [*coded, *self.rows("metrics"), *self.rows("recovery")]

    @cached_property
    def coded(self) -> tuple[DataSetPlan, ...]:
        """Data sets of which at least one cloud is coded."""
        names = {dataset for dataset, _, _ in self.curves}
        return tuple(data for name, data in self.datasets.items() if name in names)

    @cache  # noqa: B019
    def codes(self, codec: str, dataset: str) -> bool:
        """Return whether a run codes the clouds of a data set with a codec.

        It does if the configuration asks for this codec, and the codec can code such clouds.
        """
        data = self.datasets[dataset]
        return self._is_requested(codec, data) and not self._why_not(codec, data)

    def _is_requested(self, codec: str, data: DataSetPlan) -> bool:
        return data.settings.codecs is None or codec in data.settings.codecs

    def _why_not(self, codec: str, data: DataSetPlan) -> str:
        """Return why a codec codes no cloud of a data set, or an empty text."""
        rates = self.rates(codec, data.frame)
        if not rates:
            where = "clouds in metres (metric_rates)" if data.frame == "metric" else "scaled clouds"
            return f"it has no rates for {where}"
        opened, kind = self.opened[codec], self._kind(data)
        reasons = [skip_anywhere(opened, kind, rate) for rate in rates]
        return reasons[0] or "" if all(reasons) else ""

    def _kind(self, data: DataSetPlan, extent_m: float | None = None) -> CloudKind:
        return CloudKind(data.frame, data.has_returns, data.has_packets, extent_m)

    @cached_property
    def frames(self) -> tuple[CoordinateFrame, ...]:
        """Coordinate frames of the run's clouds, each once."""
        return tuple(dict.fromkeys(data.frame for data in self.datasets.values()))

    def in_frame(self, frame: CoordinateFrame) -> list[str]:
        """Return the names of the data sets whose clouds are in a coordinate frame."""
        return [name for name, data in self.datasets.items() if data.frame == frame]

    def rates(self, codec: str, frame: CoordinateFrame) -> tuple[str, ...]:
        """Return the names of a codec's rates for clouds in a coordinate frame."""
        return tuple(rates_of(self.opened[codec], frame))

    def _segmentations(self) -> Iterator[tuple[str, SegmentationPlan]]:
        for name, value in self.config.train_segmentation.items():
            for network, plan in self._networks(name, value):
                if not self.has_failed("segmentation", network):
                    yield network, plan

    def _networks(
        self, name: str, value: SegmentationTrainingConfig
    ) -> Iterator[tuple[str, SegmentationPlan]]:
        """Yield the names and plans of an entry's networks, one for each seed."""
        where = f"train_segmentation.{name}"
        seed = self.config.seed if value.seed is None else value.seed
        steps = {} if value.steps is None else {"steps": value.steps}
        for data in (*value.datasets, *value.validate_):
            if data in self.config.datasets and not self.config.datasets[data].is_metric:
                raise InputError(f"{where}: the data set {data} is not in metres (size: metric)")
        clouds, validate = self._training_clouds(where, value)
        for each in value.seeds or (seed,):
            settings = {**value.options, "seed": each, **steps}
            with naming(where):
                open_segmentation_training(settings)
            network = f"{name}-{each}" if value.seeds else name
            yield network, SegmentationPlan(clouds, validate, settings)

    def _training_clouds(
        self, where: str, value: TrainingConfig | SegmentationTrainingConfig
    ) -> list[tuple[tuple[str, str], ...]]:
        """Return the clouds of a training, and those of its validation."""
        return [
            tuple(cloud for data in names for cloud in self._clouds(f"{where}.{key}", data))
            for key, names in (("datasets", value.datasets), ("validate", value.validate_))
        ]

    def _training(self, name: str, value: TrainingConfig) -> TrainingPlan:
        where = f"train.{name}"
        seed = self.config.seed if value.seed is None else value.seed
        steps = {} if value.steps is None else {"steps": value.steps}
        settings = {**value.options, "seed": seed, **steps}
        entry = self.config.codec(value.codec) if value.codec in self.config.codecs else {}
        with naming(where):
            open_training(value.codec, entry, settings)
            start = self._start(value.start)
        clouds, validate = self._training_clouds(where, value)
        return TrainingPlan(value.codec, entry, clouds, validate, start, settings)

    def _lacks_start(self, name: str, value: TrainingConfig) -> bool:
        """Return whether a training failed, or the training of its initial weights failed."""
        start = self.config.train.get(value.start or "")
        return self.has_failed("weights", name) or bool(
            self.config.failed and start and value.start not in self.trainings
        )

    def _start(self, start: str | None) -> str | None:
        if start in self.trainings:
            return str(self.results / "weights" / f"{start}.safetensors")
        refuse_paths(filter(None, [start]))
        if start is None:
            return None
        require_networks()
        from pcc_networks.catalogue import weights_file

        return str(weights_file(start))

    def _clouds(self, where: str, name: str) -> list[tuple[str, str]]:
        if name not in self.config.datasets:
            raise InputError(f"{where}: no data set '{name}'{among(name, self.config.datasets)}")
        if name in self.datasets:
            return [(name, cloud) for cloud in self.datasets[name].clouds]
        if name in self.left_out:
            raise _unusable(name, self.left_out[name])
        return []

    def _dataset(self, name: str, value: DataSetConfig) -> DataSetPlan:
        scenes = self.checked_scenes(f"datasets.{name}", value)
        has_returns = value.is_metric and (value.is_scan or scenes.scenes.of_returns)
        if scenes.scenes.of_returns and not value.is_metric:
            raise InputError(
                f"datasets.{name}.size: {scenes.loader} has a sensor's returns (size: {METRIC})"
            )
        if value.size == GRID and value.make != "cloud":
            raise InputError(
                f"datasets.{name}.size: a grid is only for captured clouds (make: cloud)"
            )
        points = _points(f"datasets.{name}", value)
        if scenes.scenes.of_returns:
            points = _RETURNS
        sources = {
            cloud: source
            for cloud, source in self._sources(value, self._usable(name, scenes))
            if not self.has_failed("scenes", scenes.name, source[0])
            and not any(self.has_failed(kind, name, cloud) for kind in _MAKING)
        }
        if scenes.scenes.read_first:
            checks = self._checks(name, sources).values()
            points = max((check.points or 0 for check in checks), default=0) or points
        packets = has_returns and scenes.scenes.of_packets
        return DataSetPlan(name, scenes.name, sources, points, value, has_returns, packets)

    @property
    def timing(self) -> dict[str, Any]:
        """Settings of steps that measure times (`puckbench.steps.coding.TimingSettings`)."""
        timing = self.config.timing
        return {name: getattr(timing, name) for name in TimingSettings.model_fields}

    def coding_entry(self, dataset: str, codec: str, rates: Iterable[str]) -> dict[str, Any]:
        """Return a codec's complete entry in the configuration, reduced to some rates.

        Parameters
        ----------
        dataset
            Name of the data set; the rates are those for its coordinate frame.
        codec
            Name of the codec.
        rates
            Names of the rates to keep.
        """
        table = rates_of(self.opened[codec], self.datasets[dataset].frame)
        return self.entry_with(codec, {rate: table[rate] for rate in rates})

    def entry_with(self, codec: str, rates: Mapping[str, Any]) -> dict[str, Any]:
        """Return a codec's complete entry in the configuration, with only the given rates.

        `rates` maps names of rates to the codec's parameters at them. If they are budgets of bits,
        the entry also has the rates among which the codec chooses.
        """
        if budgets := budgets_among(self.opened[codec], rates):
            return {**self.codecs[codec], **codecs.rate_tables(self.opened[codec], budgets)}
        entry = {key: value for key, value in self.codecs[codec].items() if key != "metric_rates"}
        if all(is_length(self.opened[codec], rate) for rate in rates):
            return {**entry, "rates": {}, "metric_rates": rates}
        return {**entry, "rates": rates}

    @cache  # noqa: B019 (one plan lives as long as the process)
    def files_digest(self, codec: str) -> str:
        """Return a text that changes with the files that a codec uses; empty if it uses none.

        They are its weights, the programs that it runs and, if the codec is the user's own, the
        files that its code, options and rates name (`puckbench.planning.codec_files`).
        """
        programs = program_digests(self.opened[codec], self.memory)
        named = files_digest(self.named_files(codec), self.memory)
        return " ".join(filter(None, (*map(sha256, self.weights[codec]), *programs, named)))

    def named_files(self, codec: str) -> set[Path]:
        """Return the files that the code, options and rates of a user's codec name."""
        entry = self.codecs[codec]
        if entry["class"].startswith("puckbench."):
            return set()
        return files_of_codec(self.opened[codec], entry, self._no_codec_files)

    @cached_property
    def _no_codec_files(self) -> frozenset[Path]:
        """Absolute paths of the results folder and of the inputs of the run."""
        return frozenset(path.absolute() for path in (self.results, *self._input_files()))

    def checked_scenes(self, where: str, value: Sensing) -> SceneSetPlan:
        """Return the scene set from which a data set or drive is made, after checking the entry.

        Parameters
        ----------
        where
            Place of the entry in the configuration (``datasets.NAME``), for error messages.
        value
            The entry of the data set or drive.

        Raises
        ------
        InputError
            There is no such scene set, ``make`` does not suit its scenes (meshes are sampled or
            scanned, clouds are taken as they are), or the entry names an unknown codec.
        """
        scenes = self.scene_sets.get(value.scene_set)
        if scenes is None:
            choices = among(value.scene_set, self.scene_sets)
            raise InputError(f"{where}.scene_set: no scene set '{value.scene_set}'{choices}")
        is_cloud = scenes.scenes.of_clouds
        if is_cloud != (value.make == "cloud"):
            made = get_args(type(value).model_fields["make"].annotation)
            how = "cloud" if is_cloud else " or ".join(make for make in made if make != "cloud")
            what = f"{scenes.loader} has {'clouds' if is_cloud else 'meshes'}: {how}"
            raise InputError(f"{where}.make is {value.make!r}, but {what}")
        for codec in value.codecs or ():
            if codec not in self.config.codecs:
                choices = among(codec, self.config.codecs)
                raise InputError(f"{where}.codecs: no codec '{codec}'{choices}")
        return scenes

    def _sources(
        self, value: DataSetConfig, scenes: Iterable[str]
    ) -> Iterator[tuple[str, tuple[str, int]]]:
        seed = self.config.seed if value.seed is None else value.seed
        for scene in scenes:
            if value.seeds is None:
                yield scene, (scene, seed)
            else:
                yield from ((f"{scene}-{seed}", (scene, seed)) for seed in value.seeds)

    def code_of_scan(self, entry: Sensing) -> tuple[SensingCode, str]:
        """Return the code of the scans of a data set or drive, and a text of what else they are of.

        The text changes with parameters, the scene set, and the content of files.
        """
        key = entry.model_dump_json(include=set(SensorSettings.model_fields))
        if key not in self._scan_codes:
            self._scan_codes[key] = code_of_scan(entry)
        code = self._scan_codes[key]
        return code, f"{code.parameters} {entry.scene_set} {self.digest_of(code.files)}"

    @cached_property
    def digests(self) -> dict[Path, str]:
        """Digest of the content of each input file that is known before the run, by path."""
        return file_digests(self._input_files(), self.memory)

    def digest_of(self, paths: Iterable[str | Path]) -> str:
        """Return 16 hexadecimal digits that change with the content of any of some input files.

        The text is empty if `paths` is empty.
        """
        files = [Path(path) for path in paths]
        if unplanned := [file for file in files if file not in self.digests]:
            self.digests.update(file_digests(unplanned, self.memory))
        digests = [self.digests[file] for file in files]
        return hashlib.sha256(" ".join(digests).encode()).hexdigest()[:16] if digests else ""

    def _input_files(self) -> Iterator[Path]:
        config = self.config
        used = {entry.scene_set for entry in (*config.datasets.values(), *config.drives.values())}
        for scenes in self.scene_sets.values():
            if scenes.name in used:
                yield from (file for name in scenes.chosen for file in scenes.scenes.files(name))
        yield from (Path(drive.poses) for drive in config.drives.values() if drive.poses)
        for capture in config.sensor_study.captures.values() if config.sensor_study else ():
            yield from recording_files(Path(capture.path))

    def _checks(self, dataset: str, scenes: Iterable[str]) -> dict[str, SceneCheck]:
        checks = read_checks(self.memory, f"checks/{dataset}.json")
        return {scene: checks[scene] for scene in scenes if scene in checks}

    def _usable(self, name: str, scenes: SceneSetPlan) -> tuple[str, ...]:
        if not self._check_scenes:
            return scenes.chosen
        settings, checks = self.config.datasets[name], (self.memory, f"checks/{name}.json")
        faults = scene_faults(scenes.scenes, scenes.chosen, settings, *checks, self.digest_of)
        usable = tuple(scene for scene in scenes.chosen if scene not in faults)
        if faults and self.config.strict:
            raise _unusable(name, faults)
        if faults:
            self.left_out[name] = faults
        return usable

    def _study(self, value: StudyConfig) -> StudyPlan | None:
        seed = self.config.seed if value.seed is None else value.seed
        study = _study(value, seed)
        models = {
            name: model
            for name, model in study.models.items()
            if not self.has_failed("residuals", "models", name)
            and not self.has_failed("wall_points", name)
        }
        captures = {
            name: capture
            for name, capture in study.captures.items()
            if not self.has_failed("residuals", "captures", name)
        }
        is_empty = bool(study.models) and not models
        return None if is_empty else replace(study, models=models, captures=captures)


def _runnable(drives: Mapping[str, DriveConfig]) -> dict[str, DriveConfig]:
    runnable = {}
    for name, drive in drives.items():
        tasks = {
            task: options for task, options in drive.tasks.items() if not TASKS.get(task).missing
        }
        if tasks:
            runnable[name] = drive.replaced(tasks=tasks)
    return runnable


def _file_of(dataset: str, scenes: SceneSet, scene: str) -> str:
    return printable(next(iter(scenes.files(scene)), f"{dataset}/{scene}"))


def _unusable(dataset: str, faults: Mapping[str, str]) -> InputError:
    scene, fault = next(iter(faults.items()))
    more = f" (and {len(faults) - 1} more that cannot be used)" if len(faults) > 1 else ""
    return InputError(f"datasets.{dataset}: scene {scene}: {fault}{more}")


def open_scenes(name: str, value: SceneSetConfig, seed: int) -> SceneSetPlan:
    """Open a scene set of the configuration, and select its scenes.

    Parameters
    ----------
    name, value
        Name of the scene set, and its entry.
    seed
        Seed of generated scenes if the entry has none.

    Raises
    ------
    InputError
        The loader or its options are invalid, files are missing, or a selected scene is unknown.
    """
    scene_seed = seed if value.seed is None else value.seed
    with naming(f"scene_sets.{name}"):
        scenes = open_scene_set(value.loader, value.options, scene_seed)
        names = scenes.names()
    selected = _chosen(name, value, names)
    return SceneSetPlan(name, value.loader, scene_seed, value.options, scenes, selected)


def _weights(name: str, changes: Mapping[str, Any]) -> list[Path]:
    with naming(f"codecs.{name}"):
        opened = codecs.open_codec(name, changes)
        return sorted({path for rate in opened.rates if (path := opened.weights(rate))})


_CAPTURED_POINTS = 1_500_000
"""Assumed number of points of a captured cloud; most rooms of S3DIS have fewer."""
_RETURNS = 60_000
"""Assumed number of points of a turn, i.e. one revolution of the sensor, in a recording.

This is about the number of an HDL-32E; a VLP-16 has a third of it.
"""


def _points(where: str, settings: DataSetConfig) -> int:
    if not settings.is_scan:
        return settings.points if settings.make == "sample" else _CAPTURED_POINTS
    with naming(where):
        open_error_model(settings.errors, settings.error_options)
        sensor, sweep = load_sensor(settings.sensor), open_sweep(settings.sweep)
    return sweep.frames * sweep.steps(sensor) * sensor.lasers


def _chosen(name: str, value: SceneSetConfig, names: list[str]) -> tuple[str, ...]:
    selected = names if value.select is None else value.select
    missing = [scene for scene in selected if scene not in names]
    if missing:
        raise InputError(
            f"scene_sets.{name}.select: no scene '{missing[0]}' among its {len(names)}"
            f"{closest(missing[0], names)}"
        )
    return tuple(selected[: value.limit])


def _study(value: StudyConfig, seed: int) -> StudyPlan:
    models = {}
    for name, item in value.models.items():
        errors, options = (item.errors or name, item.error_options) if item else (name, {})
        with naming(f"sensor_study.models.{name}"):
            open_error_model(errors, options)
        models[name] = errors, options
    for name, capture in value.captures.items():
        if not Path(capture.path).exists():
            raise InputError(f"sensor_study.captures.{name}: {capture.path}: no such file")
        with naming(f"sensor_study.captures.{name}"):
            refuse_paths([capture.path])
    captures = {name: (item.path, item.options) for name, item in value.captures.items()}
    study = StudyPlan(value, models, captures, seed)
    distances = sorted(CALIBRATIONS.values())
    for distance in study.all_distances_m:
        if distance not in distances:
            places = ", ".join(f"{place:g}" for place in distances)
            raise InputError(f"sensor_study: no wall at {distance:g} m (there are {places} m)")
    return study


def spread_out(names: Sequence[str], count: int) -> list[str]:
    """Return at most `count` names, evenly spaced; two or more include the first and the last."""
    if count >= len(names):
        return list(names)
    if count == 1:
        return [names[len(names) // 2]]
    step = (len(names) - 1) / (count - 1)
    return [names[round(place * step)] for place in range(count)]
