"""Turns of recordings of real spinning LiDARs, in the sensor's own frame and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field, PositiveInt

from puckbench.core.errors import InputError, naming
from puckbench.datasets.base import DataSet, found
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene, safe_name, unique_names

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns

RECORDING_SUFFIXES = (".pcap", ".pcapng", ".bag", ".db3", ".mcap")


@LOADERS.register("recordings")
class Recordings(DataSet):
    """Turns of recordings: packet captures (.pcap, .pcapng) and ROS bags (.bag, .db3, .mcap).

    Of the VLP-16, the Puck Hi-Res or the HDL-32E, with one or two returns of each beam. Only whole
    turns are taken. Scenes are named after the file and the first turn (drive_0012).
    """

    of_clouds: ClassVar[bool] = True
    of_returns: ClassVar[bool] = True
    of_packets: ClassVar[bool] = True

    path: str | tuple[str, ...]
    """A recording, a folder with recordings, or a list of such."""
    turns: PositiveInt = 1
    """Turns that make one cloud."""
    every: PositiveInt = 1
    """Take each n-th of the clouds that follow one another, from the first."""
    start_s: float = Field(0.0, ge=0)
    """Seconds of each recording to leave out at its start."""

    def names(self) -> list[str]:
        """Names of the clouds; reads the packets of all recordings."""
        return list(self._table)

    def files(self, name: str) -> list[Path]:
        """The recording that a cloud is taken from."""
        return [found(self._table, name, str(self.path))[0]]

    def load(self, name: str) -> Scene:
        """The returns of a cloud's turns."""
        path, first = found(self._table, name, str(self.path))
        whole = _returns(path, self.start_s)
        about = {"source": path.name, "first_turn": first, "sensor": whole.sensor}
        chosen = replace(whole, turns=whole.turns[first : first + self.turns])
        return Scene(name, safe_name(path.stem), returns=chosen, about=about)

    @cached_property
    def _table(self) -> Mapping[str, tuple[Path, int]]:
        """Recording and first turn of each cloud; turn 0 and the last may be cut off."""
        table: dict[str, tuple[Path, int]] = {}
        given = (self.path,) if isinstance(self.path, str) else self.path
        paths = [path for one in given for path in _files(Path(one))]
        for path, name in zip(paths, unique_names(path.stem for path in paths), strict=True):
            count = len(_returns(path, self.start_s).turns)
            for first in range(1, count - self.turns, self.turns * self.every):
                table[f"{name}_{first:04d}"] = (path, first)
        if not table:
            raise InputError(f"{self.path}: no whole turn in the recording")
        return table


def _files(path: Path) -> list[Path]:
    """The recording at a path, or those in a folder; a folder of ROS 2 is one recording."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder (recordings should lie there)")
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return [path]
    inside = [one for one in sorted(path.iterdir()) if one.suffix.lower() in RECORDING_SUFFIXES]
    if not inside:
        raise InputError(f"{path}: no recording there ({', '.join(RECORDING_SUFFIXES)})")
    return inside


def _returns(path: Path, start_s: float) -> Returns:
    from puckbench.lidar.recordings.packet_turns import returns_of_packets
    from puckbench.lidar.recordings.reading import read_packets

    with naming(path):
        log = read_packets(path).between(start_s, float("inf"))
        return returns_of_packets(log.payloads)
