from __future__ import annotations

import glob
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

from cloud_files import clouds, meshes
from cloud_files.clouds import IN_METRES
from cloud_files.content import plain_suffix
from cloud_files.ply import has_faces
from cloud_files.poses import read_lidar_poses
from pointkit.column_tables import is_table_of
from pointkit.errors import NARROWER, InputError, naming
from pointkit.files import special_kind, write_bytes
from pointkit.geometry.cloud import CoordinateFrame
from pointkit.lidar.return_table import ReturnTable
from pointkit.yaml_files import yaml_text
from puckbench.codecs.base import CloudKind
from puckbench.codecs.coding import skip_reason, why_not_here
from puckbench.codecs.rates import (
    budget_of,
    check_lengths,
    find_rate,
    is_length,
    metric_rates,
    rates_of,
    scaled_rates,
)
from puckbench.codecs.registry import open_codec
from puckbench.geometry.scaling import METRIC
from puckbench.planning.config import checked, trusted
from puckbench.planning.costs import costs_of
from puckbench.planning.plan import Plan, spread_out
from puckbench.planning.scene_checks import printable
from puckbench.scene_sets import captured_rooms, recordings
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.user_files import (
    BESIDE_FRAMES,
    check_units,
    is_file_or_lost,
    is_named,
)

Kind = Literal["clouds", "meshes", "recordings", "recorded_clouds", "capture_tables"]
Options = dict[str, Any]

CONFIG = "config.yaml"
"""File name of the configuration in the results folder."""
_CUBE = 1024
_TURNS = 10
"""Default number of turns (revolutions of the sensor) of recordings, evenly spaced."""
_DRIVE, _TURNS_OF_DRIVE = "drive", 100
"""Name of the drive of a run with poses, and default number of its turns."""
_POINTS = 100_000
"""Default number of points sampled on a mesh."""
_BUDGET_S = 480.0
"""If coding all rates on one core is estimated to take more seconds, fewer rates are coded."""
_FEW_RATES = 4
"""Number of rates that a BD-rate needs."""
_MEASURING_S = 3.5
"""Estimated time, in s, to measure a million decoded points."""
CODECS = ("draco", "gpcc")
CODECS_OF_RECORDINGS = ("gpcc", "gpcc_predictive", "puck")
"""Default codecs: `CODECS` for clouds and meshes, and these for recordings."""
_LOADERS: dict[Kind, str] = {
    "clouds": "point_clouds",
    "meshes": "mesh_files",
    "recordings": "recordings",
    "recorded_clouds": "recorded_clouds",
    "capture_tables": "capture_tables",
}
_OPTIONS: dict[Kind, tuple[str, ...]] = {
    "clouds": ("drop_invalid", "keep_missing", "bin_columns", "metres_per_unit"),
    "meshes": ("up", "metres_per_unit"),
    "recordings": ("topic", "stream"),
    "recorded_clouds": ("drop_invalid", "keep_missing", "topic"),
    "capture_tables": (),
}
"""Names of the loaders' options, by kind of input."""
_RECORDED: tuple[Kind, ...] = ("recordings", "recorded_clouds")
_OF_TURNS: tuple[Kind, ...] = (*_RECORDED, "capture_tables")
_TABLE = ".parquet"
_EXAMPLES: dict[str, str] = {
    **dict.fromkeys(("clouds", "meshes", "recorded_clouds", "capture_tables"), "object"),
    "scans": "noisy",
}
_OWN_CLASS = re.compile(r".+\.py:(?P<file>\w+)|[\w.]+:(?P<module>\w+)")
_KEYS: dict[CoordinateFrame, str] = {"scaled": "rates", "metric": "metric_rates"}
"""Keys of a codec's entry that list names of rates, by coordinate frame."""
NOTHING_THERE = "no cloud, mesh or recording"
_MARK = "# Made by puckbench run"


@dataclass(frozen=True)
class UserRun:
    """What ``puckbench run FILE ...`` is asked to do, from which it makes a configuration.

    Parameters
    ----------
    paths
        Files, folders and patterns (``scans/*.ply``) of clouds, meshes and recordings.
    codecs
        Names of codecs, or places of the user's own (``file.py:Class``); Bjontegaard deltas compare
        the others with the first. Empty selects default codecs.
    results
        Folder of the results.
    frame
        Coordinate frame in which clouds and meshes are coded: ``metric`` keeps metres, ``scaled``
        scales them to a cube. By default, clouds whose formats are all in
        `cloud_files.clouds.IN_METRES` stay in metres, and others, and meshes, are scaled.
    rates
        Names of rates, or ``("all",)``; by default all, or four if all would take long.
    metrics
        Names of further metrics of every decoded cloud, or places of the user's own functions.
    scan
        Whether meshes are scanned by the virtual sensor; otherwise, points are sampled on them.
    errors
        Name of the error model of these scans.
    points
        Number of points sampled on a mesh that is not scanned, by default 100,000.
    limit
        Maximum number of clouds, meshes or turns (revolutions of the sensor) of each kind of file;
        by default 10 turns of recordings, and all others.
    strict
        Whether to raise InputError for an unusable file, and not to leave it out.
    peak
        PSNR peak, in m, of clouds in metres; by default `puckbench.metrics.default_peak.PEAK_M`.
    timeout_s
        Seconds after which a job fails; by default no limit.
    poses
        File of the sensor's poses. The clouds, which are then in metres, are also a drive of
        consecutive turns, at most `limit` (by default 100), on which odometry runs.
    options
        Options of the loaders that read the files, by name.
    """

    paths: tuple[str, ...]
    codecs: tuple[str, ...]
    results: str
    frame: CoordinateFrame | None = None
    rates: tuple[str, ...] = ()
    metrics: tuple[str, ...] = ()
    scan: bool = False
    errors: str = "vlp16_divergence"
    points: int | None = None
    limit: int | None = None
    strict: bool = False
    peak: float | None = None
    timeout_s: float | None = None
    poses: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    _reductions: dict[str, str] = field(default_factory=dict, init=False, repr=False)
    """Notes for the table ``left_out``, by subject: omitted turns or rates, or unknown units."""
    _bags: dict[Path, bool] = field(default_factory=dict, init=False, repr=False)
    """Whether each ROS bag or compressed recording contains clouds; else it has data packets."""

    def configuration(self) -> Options:
        """Return the configuration of the run, as it is written to a file.

        The files are looked at, and clouds and meshes are checked.

        Raises
        ------
        InputError
            No file can be used, or an option does not fit the files.
        """
        paths_by_kind = self._sorted_paths()
        self._check_results(paths_by_kind)
        self._check_units(paths_by_kind)
        with naming("--rates"):
            check_lengths(self.rates)
        if self.poses:
            read_lidar_poses(self.poses)  # for an error before other files are read
        scenes = {kind: self._scenes(kind, paths) for kind, paths in paths_by_kind.items()}
        datasets = {self._name(kind): self._dataset(kind, scenes[kind]) for kind in paths_by_kind}
        self._set_peak(datasets)
        if self.frame == "scaled" and set(paths_by_kind) == {"recordings"}:
            raise InputError("--frame scaled: recordings are coded in metres")
        config: Options = {
            "results": self.results,
            **({"strict": True} if self.strict else {}),
            "scene_sets": scenes,
            "datasets": datasets,
            "codecs": codec_entries(self.codecs or self._default_codecs(set(paths_by_kind))),
            **({"metrics": list(self.metrics)} if self.metrics else {}),
            "timing": {"repeats": 1, **({"timeout_s": self.timeout_s} if self.timeout_s else {})},
        }
        if self.poses:
            config["scene_sets"] = {**scenes, _DRIVE: self._scenes_of_drive(scenes)}
            config["drives"] = {_DRIVE: self._drive(self.poses)}
        plan = Plan(trusted(config), check_scenes=True)
        plan.memory.save()  # so that the run does not read the files again
        rates = self._chosen_rates(plan)
        config["codecs"] = {name: config["codecs"][name] | rates[name] for name in rates}
        if unused := {**self.unused(), **self._reductions}:
            config["unused"] = unused
        count = len(plan.clouds)
        config["figures"] = {"examples": dict(self._examples(plan))}
        config["report"] = {"title": f"Compression of {count} cloud{'s' if count > 1 else ''}"}
        checked(config)
        return config

    # ---- files

    def unused(self) -> dict[str, str]:
        """Return the given paths at which there is nothing to use, each with the reason."""
        return {text: _why_unused(text) for text, kinds in self._kinds if not kinds}

    @cached_property
    def _kinds(self) -> list[tuple[str, set[Kind]]]:
        return [
            (text, {kind for path in _files(text) if (kind := self._kind(path))})
            for text in self.paths
        ]

    def _kind(self, path: Path) -> Kind | None:
        suffix = path.suffix.lower()
        if not (path.is_dir() or suffix in (*recordings.BAG_SUFFIXES, recordings.COMPRESSED)):
            return _kind(path)
        if path not in self._bags:
            try:
                self._bags[path] = recordings.is_bag_of_clouds(path, self.options.get("topic"))
            except InputError:  # the loader reports it
                self._bags[path] = False
        return "recorded_clouds" if self._bags[path] else "recordings"

    def _sorted_paths(self) -> dict[Kind, list[str]]:
        paths_by_kind: dict[Kind, list[str]] = {}
        unused = self.unused()
        if unused and (self.strict or len(unused) == len(self._kinds)):
            raise InputError("{}: {}".format(*next(iter(unused.items()))))
        for text, kinds in self._kinds:
            for kind in kinds:
                paths = [text]
                if kind in _RECORDED and kinds.issuperset(_RECORDED):
                    files = recordings.recordings_at(text)
                    paths = [str(path) for path in files if self._kind(path) == kind]
                paths_by_kind.setdefault(kind, []).extend(paths)
        self._check_options({*paths_by_kind})
        return {kind: paths_by_kind[kind] for kind in _LOADERS if kind in paths_by_kind}

    def _check_options(self, kinds: Set[Kind]) -> None:
        if "topic" in self.options and not kinds & {*_RECORDED}:
            raise InputError("--topic: only ROS bags have topics")
        for name in self.options:
            takers = [kind for kind, names in _OPTIONS.items() if name in names]
            if not kinds & {*takers}:
                what = " and ".join(takers).replace("_", " ")
                raise InputError(f"--{name.replace('_', '-')}: only for {what}")
        if "bin_columns" in self.options and not self._has(".bin"):
            raise InputError("--bin-columns: only for .bin files")
        if "meshes" not in kinds and (self.scan or self.points is not None):
            raise InputError(f"--{'scan' if self.scan else 'points'}: only for meshes")
        if self.scan and self.points is not None:
            raise InputError("--points: not with --scan")

    def _has(self, suffix: str) -> bool:
        files = (path for text, _ in self._kinds for path in _files(text))
        return any(plain_suffix(path) == suffix for path in files)

    def _check_results(self, paths_by_kind: Mapping[Kind, Iterable[str]]) -> None:
        results = Path(self.results).resolve()
        for text in (text for paths in paths_by_kind.values() for text in paths):
            if Path(text).is_dir() and results.is_relative_to(Path(text).resolve()):
                raise InputError(
                    f"--out {self.results}: is inside {text}, which is read: name another folder"
                )

    def _check_units(self, paths_by_kind: Mapping[Kind, Iterable[str]]) -> None:
        texts = {text for paths in paths_by_kind.values() for text in paths}
        files = (path for text in texts for path in _files(text))
        scaled = [path for path in files if self._kind(path) in ("clouds", "meshes")]
        with naming("--metres-per-unit"):
            check_units(self.options.get("metres_per_unit", 1.0), scaled)

    def _scenes(self, kind: Kind, paths: list[str]) -> Options:
        options = {key: self.options[key] for key in _OPTIONS[kind] if key in self.options}
        if isinstance(units := options.get("metres_per_unit"), dict):
            files = [path for text in paths for path in _files(text) if self._kind(path) == kind]
            named = {name for name in units if any(is_named(path, name) for path in files)}
            options["metres_per_unit"] = {name: units[name] for name in units if name in named}
        options = {"path": paths[0] if len(paths) == 1 else paths, **options}
        entry: Options = {"loader": _LOADERS[kind], "options": options}
        if kind not in _OF_TURNS:
            return {**entry, **({"limit": self.limit} if self.limit else {})}
        for path in (path for text in paths if Path(text).is_dir() for path in _files(text)):
            if recordings.is_copy(path):
                self._reductions[str(path)] = "taken for a copy of the recording of its name"
        scenes = open_scene_set(_LOADERS[kind], options)
        unusable = len(scenes.unusable) if isinstance(scenes, recordings.RecordingSet) else 0
        names, limit = scenes.names(), self.limit or _TURNS
        turns = len(names) - unusable
        if turns <= limit:
            return entry
        what = "whole turns" if kind == "recordings" else "clouds"
        self._reductions[kind] = f"{limit} of {turns} {what} are coded (--limit)"
        return {**entry, "select": [*names[:unusable], *spread_out(names[unusable:], limit)]}

    # ---- data sets

    def _name(self, kind: Kind) -> str:
        return "scans" if kind == "meshes" and self.scan else kind

    def _dataset(self, kind: Kind, scenes: Options) -> Options:
        if kind == "recordings":
            return {"scene_set": kind, "make": "cloud", "size": METRIC}
        frame = self.frame or self._default_frame(kind, scenes)
        size = {"size": METRIC if frame == "metric" else _CUBE}
        if kind in ("clouds", "recorded_clouds", "capture_tables"):
            return {"scene_set": kind, "make": "cloud", **size}
        if not self.scan:
            return {"scene_set": kind, "make": "sample", "points": self.points or _POINTS, **size}
        sweep = "spin" if frame == "metric" else {"duration_s": 1.0}
        return {"scene_set": kind, "make": "scan", "errors": self.errors, "sweep": sweep, **size}

    def _scenes_of_drive(self, scenes: Mapping[Kind, Options]) -> Options:
        """Return the scene set of consecutive turns."""
        if len(scenes) != 1 or "meshes" in scenes:
            raise InputError("--poses: only for the turns of recordings, or for a folder of frames")
        ((_, entry),) = scenes.items()
        kept = {key: entry[key] for key in ("loader", "options")}
        return {**kept, "limit": self.limit or _TURNS_OF_DRIVE}

    def _drive(self, poses: str) -> Options:
        rates = {"rates": list(self.rates)} if self.rates not in {(), ("all",)} else {}
        tasks: Options = {"odometry": {}}
        return {"scene_set": _DRIVE, "make": "cloud", "poses": poses, "tasks": tasks, **rates}

    def _default_frame(self, kind: Kind, scenes: Options) -> CoordinateFrame:
        if self.poses:
            return "metric"
        if kind in ("recorded_clouds", "capture_tables"):
            return "metric"
        return "scaled" if kind == "meshes" else self._frame_of_clouds(scenes)

    def _frame_of_clouds(self, scenes: Options) -> CoordinateFrame:
        scene_set = open_scene_set(scenes["loader"], scenes["options"])
        files = (scene_set.files(name)[0] for name in scene_set.names())
        suffixes = sorted(set(map(plain_suffix, files)))
        others = [suffix for suffix in suffixes if suffix not in IN_METRES]
        if not others:
            return "metric"
        unlike = [suffix for suffix in suffixes if suffix in IN_METRES]
        self._reductions["unit of clouds"] = (
            f"none in {', '.join(others)}{', unlike ' if unlike else ''}{', '.join(unlike)}: all "
            f"clouds are scaled to [0, {_CUBE - 1}]; --frame metric keeps them in metres"
        )
        return "scaled"

    def _set_peak(self, datasets: Mapping[str, Options]) -> None:
        if self.peak is None:
            return
        metric = [data for data in datasets.values() if data["size"] == METRIC]
        if not metric:
            raise InputError("--peak: only for clouds in metres (--frame metric)")
        for data in metric:
            data["peak"] = self.peak

    def _examples(self, plan: Plan) -> Iterator[tuple[str, str]]:
        taken = set()
        for dataset, data in plan.datasets.items():
            kind = "spin" if data.has_returns else _EXAMPLES[dataset]
            if kind not in taken:
                taken.add(kind)
                yield kind, f"{dataset}/{data.clouds[0]}"

    # ---- codecs

    def _default_codecs(self, kinds: Collection[Kind]) -> tuple[str, ...]:
        clouds = CODECS if set(kinds) != {"recordings"} else ()
        return (
            *dict.fromkeys([*clouds, *(CODECS_OF_RECORDINGS if "recordings" in kinds else ())]),
        )

    def _chosen_rates(self, plan: Plan) -> dict[str, Options]:
        """Return the lists of rates for the entries of those codecs that can code a cloud."""
        faults = _faults_of_codecs(plan, advice=True)
        few = not self.rates and _seconds(plan) > _BUDGET_S
        changes: dict[str, Options] = {}
        for codec in (codec for codec in plan.codecs if codec not in faults):
            offered = {frame: rates for frame in plan.frames if (rates := plan.rates(codec, frame))}
            chosen = {frame: self._selected_rates(plan, codec, frame, few) for frame in offered}
            if not any(chosen.values()):
                has = ", ".join(rate for rates in offered.values() for rate in rates)
                self._reductions[f"codec {codec}"] = f"none of the requested rates (it has {has})"
                continue
            if all(_is_too_wide(plan, codec, *each) for each in chosen.items() if each[1]):
                faults[codec] = f"every cloud is too wide for its rates{NARROWER}"
                continue
            for frame, selected in chosen.items():
                if few and len(selected) < len(offered[frame]):
                    counts = f"{len(selected)} of {len(offered[frame])} rates"
                    self._reductions[f"codec {codec}"] = f"{counts}: all take long (--rates all)"
            changes[codec] = {
                _KEYS[frame]: list(selected)
                for frame, selected in chosen.items()
                if selected != offered[frame]
            }
        for codec, fault in faults.items():
            if self.strict or not changes:
                raise InputError(f"codec {codec}: {fault}")
            self._reductions[f"codec {codec}"] = fault
        self._check_chosen(plan, changes, [name for name in plan.codecs if name not in faults])
        return changes

    def _check_chosen(
        self, plan: Plan, changes: Mapping[str, Options], codecs: Sequence[str]
    ) -> None:
        """Raise InputError if none of `codecs` has a requested rate for the clouds of a frame.

        `changes` has the chosen rates by codec. With `strict`, each codec must have one.
        """
        lacking = [codec for codec in codecs if codec not in changes] if self.strict else []
        for frame in plan.frames:
            offering = [codec for codec in codecs if plan.rates(codec, frame)]
            kept = [codec for codec in offering if codec in changes]
            if all(changes[codec].get(_KEYS[frame]) == [] for codec in kept):
                lacking += offering
        if lacking:
            rates = [rate for frame in plan.frames for rate in plan.rates(lacking[0], frame)]
            raise InputError(
                f"--rates: codec {lacking[0]} has none of {', '.join(self.rates)} "
                f"({', '.join(rates)}){self._other_frame(plan, lacking[0])}"
            )

    def _selected_rates(
        self, plan: Plan, codec: str, frame: CoordinateFrame, few: bool
    ) -> tuple[str, ...]:
        rates = plan.rates(codec, frame)
        if few:
            return tuple(spread_out(rates, _FEW_RATES))
        if self.rates in {(), ("all",)}:
            return rates
        is_metric, opened = frame == "metric", plan.opened[codec]
        names = [
            rate
            for rate in self.rates
            if rate in rates or (is_metric and is_length(opened, rate)) or budget_of(opened, rate)
        ]
        changes = {**plan.config.codec(codec), _KEYS[frame]: names}
        return tuple(rates_of(open_codec(codec, changes), frame)) if names else ()

    def _other_frame(self, plan: Plan, codec: str) -> str:
        for frame in get_args(CoordinateFrame):
            opened = plan.opened[codec]
            if frame not in plan.frames and any(
                is_length(opened, rate) == (frame == "metric")
                for rate in self.rates
                if find_rate(opened, rate)
            ):
                return f": use --frame {frame}"
        return ""


def _files(text: str) -> Iterator[Path]:
    path = Path(text)
    if path.is_dir() and not recordings.is_bag_folder(path):
        below = (each for each in sorted(path.rglob("*")) if each.name not in BESIDE_FRAMES)
        yield from filter(is_file_or_lost, below)
    elif path.exists():
        yield from () if special_kind(path) else (path,)
    else:
        matches = map(Path, sorted(glob.glob(text, recursive=True)))  # noqa: PTH207 (any pattern)
        yield from (each for each in matches if each.is_file() or recordings.is_bag_folder(each))


def _why_unused(text: str) -> str:
    from puck.recordings.ouster import osf_advice

    path = Path(text)
    if path.is_symlink() and not path.exists():
        return "a link to a file that is gone"
    if not path.exists() and not glob.glob(text, recursive=True):  # noqa: PTH207 (any pattern)
        return "no such file"
    if kind := special_kind(path):
        return f"{kind}, not a file"
    if path.suffix.lower() == ".osf":
        return osf_advice(path)
    suffixes = ", ".join(dict.fromkeys((*clouds.SUFFIXES, *meshes.SUFFIXES)))
    others = ", ".join(recordings.RECORDING_SUFFIXES)
    return f"{NOTHING_THERE} there ({suffixes}, {others}, {_TABLE} of capture)"


def _kind(path: Path) -> Kind | None:
    suffix = plain_suffix(path)
    if path.is_dir() or path.suffix.lower() in recordings.RECORDING_SUFFIXES:
        return "recordings"
    if suffix == _TABLE:
        return "capture_tables" if is_table_of(path, ReturnTable) else None
    if suffix == ".ply":
        return "meshes" if has_faces(path) else "clouds"
    if suffix in clouds.SUFFIXES:
        return "clouds"
    is_mesh = suffix in meshes.SUFFIXES or (
        suffix == ".json" and captured_rooms.is_captured_room(path)
    )
    return "meshes" if is_mesh else None


def codec_entries(codecs: Sequence[str]) -> dict[str, Options]:
    """Return entries of a configuration for codecs given on the command line.

    A codec is given by its registered name, or by the place of the user's class
    (``path/to/file.py:Class``). Such a class is named after itself in lower case with underscores.
    """
    entries = dict(map(_codec, codecs))
    if len(entries) < len(codecs):
        raise InputError(f"--codecs: a codec is named twice: {' '.join(codecs)}")
    return entries


def check_codecs(plan: Plan, advice: bool = True) -> None:
    """Raise InputError if a codec cannot encode any cloud of a plan, or cannot run here.

    With `advice`, messages name an option of ``puckbench run`` that may help.
    """
    for name, fault in _faults_of_codecs(plan, advice).items():
        raise InputError(f"codec {name}: {fault}")


def _faults_of_codecs(plan: Plan, advice: bool) -> dict[str, str]:
    """Return why codecs cannot encode any cloud of a plan; raise InputError if one cannot run."""
    faults = {}
    for name, opened in plan.opened.items():
        if why := why_not_here(opened):
            raise InputError(f"codec {name} cannot run here: {why}")
        if not any(plan.codes(name, data) for data in plan.datasets):
            faults[name] = _why_not(plan, name, advice)
    return faults


def _codec(text: str) -> tuple[str, Options]:
    place = _OWN_CLASS.fullmatch(text)
    if place is None and text.endswith(".py"):
        raise InputError(f"--codecs {text}: add the name of its class ({text}:Class)")
    if place is None:
        return text, {}
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", place["file"] or place["module"])
    return words.lower(), {"class": text}


def _seconds(plan: Plan) -> float:
    total = 0.0
    for name, data in plan.datasets.items():
        for codec in filter(lambda codec: plan.codes(codec, name), plan.codecs):
            coding_s = costs_of(plan.opened[codec]).seconds_of(data.points)
            once = 1.5 * coding_s + _MEASURING_S * data.points / 1e6
            total += len(data.clouds) * len(plan.rates(codec, data.frame)) * once
    return total


def _is_too_wide(plan: Plan, codec: str, frame: CoordinateFrame, rates: Sequence[str]) -> bool:
    """Return whether a codec skips every cloud of a frame, as all are too wide for its rates."""
    extents = [
        plan.extents.get(name, {}).get(cloud, 0.0)
        for name in plan.in_frame(frame)
        if plan.codes(codec, name)
        for cloud in plan.datasets[name].clouds
    ]
    opened = plan.opened[codec]
    narrowest = CloudKind(frame, True, True, min(extents, default=0.0))
    return bool(extents) and all(skip_reason(opened, narrowest, rate) for rate in rates)


def _why_not(plan: Plan, codec: str, advice: bool) -> str:
    opened = plan.opened[codec]
    frames = {"scaled": "scaled clouds", "metric": "clouds in metres"}
    rates: dict[CoordinateFrame, Any] = {
        "scaled": scaled_rates(opened.rates),
        "metric": metric_rates(opened.rates),
    }
    for rate in rates["metric"]:
        if reason := skip_reason(opened, CloudKind("metric"), rate):
            return reason
    others = [frame for frame in rates if rates[frame] and frame not in plan.frames]
    other = f" (--frame {others[0]})" if others and advice else ""
    return f"has no rates for {' or '.join(frames[frame] for frame in plan.frames)}{other}"


def write_configuration(path: Path, config: Mapping[str, Any], command: str) -> None:
    """Write a configuration file, with the command that made it in a comment.

    The first line contains a digest, by which edits are noticed. A file at `path` that the user
    edited is not replaced; it raises InputError.
    """
    body = f"# {printable(command)}\n{yaml_text(dict(config))}"
    if path.exists() and not _is_as_made(path):
        raise InputError(
            f"{path}: was edited: run it (puckbench run {path}), or choose another --out"
        )
    write_bytes(path, f"{_MARK} ({_digest(body)}); yours to edit.\n{body}".encode())


def _is_as_made(path: Path) -> bool:
    head, _, body = path.read_text(encoding="utf-8", errors="replace").partition("\n")
    return head.startswith(f"{_MARK} ({_digest(body)})")


def _digest(text: str) -> str:
    import hashlib

    return hashlib.sha256(text.encode()).hexdigest()[:16]
