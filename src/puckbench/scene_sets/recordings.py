from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field, PositiveInt

from pointkit.errors import InputError, naming
from pointkit.lazy import imported
from puckbench.scene_sets.base import SceneSet, look_up
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name
from puckbench.scene_sets.user_files import is_file_or_lost, paths_at, refuse_repeated, scene_names

if TYPE_CHECKING:
    from pointkit.lidar.returns import Returns
    from puck.turn_packets import TurnIndex
    from puckbench.recordings.reading import RecordedTurns

CODE = (
    *("puckbench.scene_sets.user_files", "puckbench.recordings"),
    *("puck.records", "puck.recordings", "puck.recording", "puck.packet_kinds", "puck.windows"),
    *("puck.turn_packets", "pointkit.lidar.sensors", "cloud_files.las"),
    *("cloud_files.las_header", "cloud_files.las_units", "cloud_files.pcd", "cloud_files.text"),
    "cloud_files.text_numbers",
)

COMPRESSED = ".puck"
BAG_SUFFIXES = (".bag", ".db3", ".mcap")
CAPTURE_SUFFIXES = (".pcap", ".pcapng", *BAG_SUFFIXES)
RECORDING_SUFFIXES = (*CAPTURE_SUFFIXES, COMPRESSED)
READERS = {COMPRESSED: "puck.recording:decompress"}
"""Functions that restore a compressed recording, by suffix."""
_MOST_KEPT = 1 << 28
"""Maximum total size of the ranges in cached recordings, bytes."""


class RecordingSet(SceneSet):
    """Base class of scene sets whose scenes are numbered clouds in recordings of a sensor."""

    of_clouds: ClassVar[bool] = True
    read_first: ClassVar[bool] = True
    suffixes: ClassVar[tuple[str, ...]] = RECORDING_SUFFIXES

    path: str | tuple[str, ...] | dict[str, str]
    """A recording, a folder (with subfolders), a pattern (``drives/*.pcap``), a list of these, or
    recordings by name. The folder of a ROS 2 bag is one recording."""
    every: PositiveInt = 1
    """Use every n-th cloud, from the first on."""
    topic: str | None = None
    """Topic to read in ROS bags with several suitable topics."""

    @abstractmethod
    def _numbers(self, path: Path) -> Sequence[int]:
        """Return the indices of a recording's clouds; raise InputError if it is unusable."""

    def names(self) -> list[str]:
        """Return the names of all clouds, after those of `unusable` recordings.

        All recordings are read for this.
        """
        return list(self._clouds)

    @property
    def unusable(self) -> list[str]:
        """The names of recordings without a complete cloud.

        For such a name, `load` raises InputError with the reason.
        """
        return [name for name, (_, number) in self._clouds.items() if number is None]

    def files(self, name: str) -> list[Path]:
        return [self._place(name)[0]]

    def options_of(self, name: str) -> dict[str, Any]:
        path, number = self._place(name)
        scene_name = name if number is None else name.rpartition("_")[0]
        return {**self.model_dump(exclude_defaults=True), "path": {scene_name: str(path)}}

    def _place(self, name: str) -> tuple[Path, int | None]:
        recording, _, number = name.rpartition("_")
        if recording in self._recordings and number.isdecimal() and f"{int(number):04d}" == number:
            return self._recordings[recording], int(number)
        if name in self._recordings:
            return self._recordings[name], None
        return look_up(self._clouds, name, str(self.path))

    @cached_property
    def _recordings(self) -> Mapping[str, Path]:
        if isinstance(self.path, dict):
            return {name: Path(text) for name, text in self.path.items()}
        texts = (self.path,) if isinstance(self.path, str) else self.path
        paths = [path for text in texts for path in recordings_at(text, self.suffixes)]
        refuse_repeated(paths, "recording")
        return dict(zip(scene_names(paths), paths, strict=True))

    @cached_property
    def _clouds(self) -> Mapping[str, tuple[Path, int | None]]:
        """The recording and the number of each cloud by scene name.

        Unusable recordings come first, by recording name, with the number None.
        """
        table: dict[str, tuple[Path, int | None]] = {}
        faulty: dict[str, tuple[Path, int | None]] = {}
        for name, path in self._recordings.items():
            try:
                numbers: Sequence[int] = self._numbers(path)
            except InputError:
                numbers = range(0)
            table |= {f"{name}_{number:04d}": (path, number) for number in numbers}
            if not numbers:
                faulty[name] = (path, None)
        return faulty | table


@LOADERS.register("recordings")
class Recordings(RecordingSet):
    """Scenes are revolutions in packet captures (.pcap, .pcapng) and ROS bags (.bag, .db3, .mcap).

    The sensors are those of `puckbench capture`, with one or two returns per beam. For Ouster, the
    metadata must be in the recording or beside it. Recordings may be compressed (.puck). Incomplete
    revolutions are not used. Scenes are named after the file and the first revolution (drive_0012).
    Unusable recordings are left out and reported. Damaged and repeated packets are left out and
    counted.
    """

    of_packets: ClassVar[bool] = True

    turns: PositiveInt = 1
    """Number of turns in a cloud."""
    start_s: float = Field(0.0, ge=0)
    """Duration, in s, to leave out at the start of each recording."""
    stream: str | None = None
    """Sensor to read in packet captures of several sensors, such as ``192.168.1.201:2368`` or
    ``192.168.1.201:2368 to 255.255.255.255:2368`` (sender, receiver)."""

    @property
    def of_returns(self) -> bool:
        return True

    def files(self, name: str) -> list[Path]:
        return recording_files(self._place(name)[0])

    def load(self, name: str) -> Scene:
        from puckbench.recordings.long_recordings import read_some_turns

        path, first = self._place(name)
        index, recorded, skipped = self._index(path), None, first or 0
        if index and first is not None:
            recorded = read_some_turns(index, first, first + self.turns - 1)
        if recorded is None:
            recorded, skipped = self._read(path), 0
        recording, left_out = recorded.returns, recorded.left_out
        if first is None:
            raise InputError(f"{path}: {self._no_turns(recording)}")
        if first not in self._firsts(recorded.whole):
            look_up(self._clouds, name, str(self.path))
        about = {"source": path.name, "first_turn": first, "sensor": recording.sensor, **left_out}
        turns = recording.turns[first - skipped : first - skipped + self.turns]
        cloud_returns = replace(recording, turns=turns)
        group, time_s = safe_name(path.stem), recorded.time_s(first - skipped)
        return Scene(name, group, returns=cloud_returns, about=about, time_s=time_s)

    def _numbers(self, path: Path) -> range:
        from puckbench.recordings.long_recordings import count_whole_turns

        index = self._index(path)
        whole = count_whole_turns(index) if index else None
        return self._firsts(self._read(path).whole if whole is None else whole)

    def _index(self, path: Path) -> TurnIndex | None:
        """Return the turns of a long recording that need not be read as a whole."""
        is_selected = self.start_s or self.stream or self.topic
        return None if is_selected else _index(path)

    def _read(self, path: Path) -> RecordedTurns:
        return _read(path, self.start_s, self.stream, self.topic)

    def _firsts(self, whole: range) -> range:
        return range(whole.start, whole.stop - self.turns + 1, self.turns * self.every)

    def _no_turns(self, whole: Returns) -> str:
        lacking = "no whole turn" if self.turns == 1 else f"not {self.turns} whole turns"
        turns = len(whole.turns)
        return f"{lacking} in the recording: of {turns} turns the first and the last are cut off"


def recordings_at(text: str, suffixes: Collection[str] = RECORDING_SUFFIXES) -> list[Path]:
    """Return the paths of the recordings that a text names.

    A compressed copy beside the original recording is ignored.

    Parameters
    ----------
    text
        A path, a folder, or a pattern such as ``drives/*.pcap``. The folder of a ROS 2 bag is one
        recording.
    suffixes
        Suffixes of recordings.

    Raises
    ------
    InputError
        There are no recordings.
    """

    def is_accepted(path: Path) -> bool:
        return is_bag_folder(path) or _is_recording(path, suffixes)

    return paths_at(text, _below, is_accepted, "recordings", suffixes)


def is_bag_folder(path: Path) -> bool:
    """Return whether a path is the folder of a ROS 2 bag."""
    return (path / "metadata.yaml").is_file()


def _below(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.name.startswith("."):
            yield from [path] if is_bag_folder(path) else _below(path)
        elif not is_copy(path):
            yield path


def _is_recording(path: Path, suffixes: Collection[str]) -> bool:
    has_suffix = path.suffix.lower() in suffixes and not path.name.startswith(".")
    return has_suffix and is_file_or_lost(path)


def is_copy(path: Path) -> bool:
    """Return whether a compressed recording lies beside a recording with the same name."""
    others = (path.with_suffix(suffix) for suffix in RECORDING_SUFFIXES if suffix != COMPRESSED)
    return path.suffix.lower() == COMPRESSED and any(other.exists() for other in others)


@contextmanager
def decompressed(path: Path) -> Iterator[Path]:
    """Yield the path of a recording or, if it is compressed, of a temporary decompressed copy.

    Raises InputError if the compressed recording is damaged.
    """
    from puck.records import is_stream

    if not is_stream(path):
        yield path
        return
    with TemporaryDirectory() as folder:
        copy = decompressed_in(Path(folder), path)
        with naming_source(path, copy):
            yield copy


def decompressed_in(folder: Path, path: Path) -> Path:
    """Decompress a recording to a file in a folder, and return the path of the file.

    Raises InputError if the compressed recording is damaged.
    """
    from puck.records import is_stream

    copy = folder / "recording"
    imported(READERS[COMPRESSED])(path, copy)
    if is_stream(copy):
        raise InputError(f"{path}: a compressed recording within another; decompress it first")
    return copy


@contextmanager
def naming_source(path: Path, copy: Path) -> Iterator[None]:
    """Name a compressed recording in the place of its decompressed copy in messages of InputError.

    Parameters
    ----------
    path
        The compressed recording.
    copy
        Its copy, which the code in the `with` block reads.
    """
    try:
        yield
    except InputError as error:
        raise InputError(str(error).replace(str(copy), str(path))) from error


def is_bag_of_clouds(path: Path, topic: str | None = None) -> bool:
    """Return whether a path is a ROS bag of clouds, which may be compressed.

    Parameters
    ----------
    path
        A recording. A compressed one is decompressed if the kinds of its records do not tell.
    topic
        As for `puckbench.recordings.cloud_messages.has_clouds`, which judges the bag.

    Raises
    ------
    InputError
        The recording is damaged.
    """
    from puck.records import RecordKind, is_stream, places_of_records
    from puckbench.recordings.cloud_messages import has_clouds

    if not is_stream(path):
        return has_clouds(path, topic)
    with path.open("rb") as file, naming(path):
        kinds = {place.kind for place in places_of_records(file)}
    has_packets = RecordKind.TURN in kinds
    if topic is None and has_packets != (RecordKind.CLOUD in kinds):
        return not has_packets
    with decompressed(path) as recording:
        return has_clouds(recording, topic)


_State = tuple[tuple[str, int, int], ...]
_Key = tuple[Path, float, str | None, str | None, _State]
_indexed: dict[tuple[Path, _State], TurnIndex | None] = {}
"""The turns of the last long recording."""
_kept: dict[_Key, RecordedTurns] = {}
"""Cached recordings, in the order in which they were read."""


def _read(path: Path, start_s: float, stream: str | None, topic: str | None) -> RecordedTurns:
    from puck.recordings.ros_bags import is_bag
    from puckbench.recordings.reading import read_turns

    key = (path, start_s, stream, topic, _state(path))
    if key not in _kept:
        with decompressed(path) as recording:
            topic = topic if is_bag(recording) else None
            _kept[key] = read_turns(recording, start_s, stream, path, topic)
        sizes = [sum(turn.ranges.nbytes for turn in each.turns) for each, *_ in _kept.values()]
        while len(_kept) > 1 and sum(sizes) > _MOST_KEPT:
            del _kept[next(iter(_kept))]
            del sizes[0]
    return _kept[key]


def _index(path: Path) -> TurnIndex | None:
    from puck.records import is_stream
    from puck.turn_packets import index_turns
    from puckbench.recordings.long_recordings import is_long

    if is_stream(path) or not is_long(path):
        return None
    key = (path, _state(path))
    if key not in _indexed:
        _indexed.clear()
        _indexed[key] = index_turns(path)
    return _indexed[key]


def recording_files(path: Path) -> list[Path]:
    """Return the path of a recording, and those of files beside it that describe its sensor."""
    from pointkit.lidar.unit_calibration import calibration_beside
    from puck.recordings.ouster import metadata_beside

    beside = [None] if path.is_dir() else [metadata_beside(path), calibration_beside(path)]
    return [path, *filter(None, beside)]


def _state(path: Path) -> _State:
    files = sorted(path.iterdir()) if path.is_dir() else recording_files(path)
    stats = ((file.name, file.stat()) for file in files if file.exists())
    return tuple((name, stat.st_size, stat.st_mtime_ns) for name, stat in stats)
