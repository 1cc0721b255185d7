"""Turns of recordings of real spinning LiDARs, in the sensor's own frame and numbers."""

from __future__ import annotations

import glob
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field, PositiveInt

from puckbench.core.errors import InputError
from puckbench.core.files import unreadable
from puckbench.datasets.base import DataSet, found
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene, safe_name
from puckbench.datasets.user_files import distinct, is_file_or_lost, scene_names

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns

COMPRESSED = ".puck"
RECORDING_SUFFIXES = (".pcap", ".pcapng", ".bag", ".db3", ".mcap", COMPRESSED)
_MOST_KEPT = 1 << 28
"""Ranges of recordings that a process keeps for their next turns, at most."""


@LOADERS.register("recordings")
class Recordings(DataSet):
    """Turns of recordings: packet captures (.pcap, .pcapng) and ROS bags (.bag, .db3, .mcap).

    Of the VLP-16, the Puck Hi-Res or the HDL-32E, with one or two returns of each beam, also
    compressed (.puck). Only whole turns are taken. Scenes are named after the file and the first
    turn (drive_0012); a recording that cannot be used is left out and named. Damaged and repeated
    packets are left out and counted.
    """

    of_clouds: ClassVar[bool] = True
    of_returns: ClassVar[bool] = True
    of_packets: ClassVar[bool] = True
    read_first: ClassVar[bool] = True

    path: str | tuple[str, ...] | dict[str, str]
    """A recording, a folder with all below it, a pattern (``drives/*.pcap``), a list of such, or a
    table of names and recordings. The folder of a ROS 2 bag is one recording."""
    turns: PositiveInt = 1
    """Turns that make one cloud."""
    every: PositiveInt = 1
    """Take each n-th of the clouds that follow one another, from the first."""
    start_s: float = Field(0.0, ge=0)
    """Seconds of each recording to leave out at its start."""
    stream: str | None = None
    """Of packet captures with several sensors, the one to read, as ``192.168.1.201:2368`` or
    ``192.168.1.201:2368 to 255.255.255.255:2368`` (sender, receiver)."""

    def names(self) -> list[str]:
        """Names of the clouds, `unusable` recordings first; reads the packets of all recordings."""
        return list(self._clouds)

    @property
    def unusable(self) -> list[str]:
        """Names of recordings that have no cloud; `load` tells why."""
        return [name for name, (_, first) in self._clouds.items() if first is None]

    def files(self, name: str) -> list[Path]:
        """The recording that a cloud is taken from."""
        return [self._place(name)[0]]

    def options_of(self, name: str) -> dict[str, Any]:
        """Options of a set of this cloud's recording alone."""
        path, first = self._place(name)
        whole = name if first is None else name.rpartition("_")[0]
        return {**self.model_dump(exclude_defaults=True), "path": {whole: str(path)}}

    def load(self, name: str) -> Scene:
        """The returns of a cloud's turns; reads its recording alone.

        `about` has the counts of what was left out, where there is any.
        """
        path, first = self._place(name)
        whole, left_out = _read(path, self.start_s, self.stream)
        if first is None:
            raise InputError(f"{path}: {self._no_turns(whole)}")
        if first not in self._firsts(whole):
            found(self._clouds, name, str(self.path))
        about = {"source": path.name, "first_turn": first, "sensor": whole.sensor, **left_out}
        chosen = replace(whole, turns=whole.turns[first : first + self.turns])
        return Scene(name, safe_name(path.stem), returns=chosen, about=about)

    def _place(self, name: str) -> tuple[Path, int | None]:
        """Recording and first turn of a cloud; None where the name is a recording's."""
        recording, _, number = name.rpartition("_")
        if recording in self._recordings and number.isdecimal() and f"{int(number):04d}" == number:
            return self._recordings[recording], int(number)
        if name in self._recordings:
            return self._recordings[name], None
        return found(self._clouds, name, str(self.path))

    def _firsts(self, whole: Returns) -> range:
        """First turns of the clouds of a recording; turn 0 and the last may be cut off."""
        return range(1, len(whole.turns) - self.turns, self.turns * self.every)

    def _no_turns(self, whole: Returns) -> str:
        wanted = "no whole turn" if self.turns == 1 else f"not {self.turns} whole turns"
        turns = len(whole.turns)
        cut = "which are cut" if turns < 3 else "of which the first and the last are cut"
        return f"{wanted} among the turns of the recording, {turns}, {cut}"

    @cached_property
    def _recordings(self) -> Mapping[str, Path]:
        """Recordings by name, without reading any."""
        if isinstance(self.path, dict):
            return {name: Path(text) for name, text in self.path.items()}
        given = (self.path,) if isinstance(self.path, str) else self.path
        paths = [path for text in given for path in recordings_at(text)]
        twice = [path for path, count in Counter(map(os.path.realpath, paths)).items() if count > 1]
        if twice:
            raise InputError(f"{Path(twice[0]).name}: the recording is named twice")
        return dict(zip(scene_names(paths), paths, strict=True))

    @cached_property
    def _clouds(self) -> Mapping[str, tuple[Path, int | None]]:
        """Recording and first turn of each cloud, and the recordings that have none."""
        table: dict[str, tuple[Path, int | None]] = {}
        faulty: dict[str, tuple[Path, int | None]] = {}
        for name, path in self._recordings.items():
            try:
                firsts = self._firsts(_read(path, self.start_s, self.stream)[0])
            except InputError:
                firsts = range(0)
            table |= {f"{name}_{first:04d}": (path, first) for first in firsts}
            if not firsts:
                faulty[name] = (path, None)
        return faulty | table


def recordings_at(text: str) -> list[Path]:
    """The recordings that a path, a folder or a pattern stands for.

    The folder of a ROS 2 bag is one recording. A compressed recording beside the one that it was
    made of is no other one.
    """
    path = Path(text)
    if path.is_dir() and not is_bag_folder(path):
        inside = distinct(_below(path))
        if not inside:
            raise InputError(f"{text}: no recording there ({', '.join(RECORDING_SUFFIXES)})")
        return inside
    if path.exists():
        return [path]
    matches = map(Path, glob.glob(text, recursive=True))  # noqa: PTH207 (any pattern)
    inside = distinct(one for one in matches if is_bag_folder(one) or _is_recording(one))
    if not inside:
        raise InputError(f"{text}: no such file or folder (recordings should lie there)")
    return inside


def is_bag_folder(path: Path) -> bool:
    """Whether a path is the folder of a ROS 2 bag, which is one recording."""
    return (path / "metadata.yaml").is_file()


def _below(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.name.startswith("."):
            yield from [path] if is_bag_folder(path) else _below(path)
        elif _is_recording(path) and not _is_copy(path):
            yield path


def _is_recording(path: Path) -> bool:
    known = path.suffix.lower() in RECORDING_SUFFIXES and not path.name.startswith(".")
    return known and is_file_or_lost(path)


def _is_copy(path: Path) -> bool:
    """Whether a compressed recording lies beside the one that it was made of."""
    others = (path.with_suffix(suffix) for suffix in RECORDING_SUFFIXES if suffix != COMPRESSED)
    return path.suffix.lower() == COMPRESSED and any(other.exists() for other in others)


@contextmanager
def decompressed(path: Path) -> Iterator[Path]:
    """Yield a recording that can be read: a temporary copy if `path` is compressed, else `path`.

    A file is compressed if it begins as streams of `puckbench.puck` do, whatever its name.

    Raises
    ------
    InputError
        The compressed recording is damaged, or holds another compressed recording.
    """
    if not _is_compressed(path):
        yield path
        return
    from puckbench.puck import decompress

    with TemporaryDirectory() as folder:
        copy = Path(folder, "recording")
        decompress(path, copy)
        if _is_compressed(copy):
            raise InputError(f"{path}: a compressed recording within another; decompress it first")
        yield copy


def _is_compressed(path: Path) -> bool:
    from puckbench.puck.records import MAGIC

    if not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError as error:
        raise unreadable(path, error) from error


_State = tuple[tuple[str, int, int], ...]
_kept: dict[tuple[Path, float, str | None, _State], tuple[Returns, dict[str, int]]] = {}
"""Recordings that were read, the last one at the end."""


def _read(path: Path, start_s: float, stream: str | None) -> tuple[Returns, dict[str, int]]:
    """The turns of a recording and what was left out; read once while it fits and is the same."""
    from puckbench.lidar.recordings.reading import read_turns

    key = (path, start_s, stream, _state(path))
    if key not in _kept:
        with decompressed(path) as recording:
            _kept[key] = read_turns(recording, start_s, stream, path)
        sizes = [sum(turn.ranges.nbytes for turn in each.turns) for each, _ in _kept.values()]
        while len(_kept) > 1 and sum(sizes) > _MOST_KEPT:
            del _kept[next(iter(_kept))]
            del sizes[0]
    return _kept[key]


def _state(path: Path) -> _State:
    """Names, sizes and times of a recording's files; none where it is missing."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    stats = ((one.name, one.stat()) for one in files if one.exists())
    return tuple((name, stat.st_size, stat.st_mtime_ns) for name, stat in stats)
