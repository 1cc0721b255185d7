from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from pointkit.files import read_json

Position = tuple[float, float, float]

_KEY = re.compile(r"([A-Za-z]+_\d+)_(\d)[ab]?")
_POSE = re.compile(r"camera_([0-9a-f]+)_+([A-Za-z]+_\d+)(?:_\d+)*_+frame_.+_pose\.json")
_FOLDERS = ("data/pose", "pano/pose")


def listed_file(folder: Path, area: str) -> Path:
    return folder / f"locations_pruned{area}.json"


def listed_positions(path: Path, area: str) -> dict[str, Position]:
    """Read the scanner positions of an area's rooms from a JSON file.

    Parameters
    ----------
    path
        The file, with keys such as office_6_1 for a room of area 6.
    area
        Name of the area.

    Returns
    -------
    dict
        Positions in m by name of the room.

    Raises
    ------
    InputError
        The file is damaged, or a key is not a room of the area.
    """
    content = read_json(path)
    if not isinstance(content, dict) or not content:
        raise InputError(f"{path}: not a list of positions by room")
    rooms = {}
    for key, value in content.items():
        match = _KEY.fullmatch(key)
        if match is None or match[2] != area[0]:
            raise InputError(f"{path}: '{key}' is not a room of area {area}, such as office_6_1")
        rooms[match[1]] = _position(value, f"{path}: {key}")
    return rooms


def pose_files(area_folder: Path) -> dict[str, list[Path]]:
    """Return the camera pose files of each room, one for each position of the tripod.

    The result is a dict of paths by room name. Raises InputError if there are no such files.
    """
    for name in _FOLDERS:
        rooms: dict[str, dict[str, Path]] = {}
        for path in sorted((area_folder / name).glob("camera_*.json")):
            match = _POSE.fullmatch(path.name)
            if match is not None:
                rooms.setdefault(match[2], {}).setdefault(match[1], path)
        if rooms:
            return {room: list(tripods.values()) for room, tripods in rooms.items()}
    raise InputError(
        f"{area_folder / _FOLDERS[0]}: no camera_*_pose.json, which give the scanner positions "
        "(expected those of 2D-3D-S; or set the option positions)"
    )


def camera_position(path: Path) -> Position:
    """Read the position of a camera, in m, from a pose file.

    Older files contain a list of poses, of which the first counts.
    """
    content = read_json(path)
    pose = content[0] if isinstance(content, list) and content else content
    if not isinstance(pose, dict) or "camera_location" not in pose:
        raise InputError(f"{path}: the pose has no camera_location")
    return _position(pose["camera_location"], str(path))


def _position(value: Any, what: str) -> Position:
    numbers = value if isinstance(value, list) else []
    good = [x for x in numbers if isinstance(x, int | float) and math.isfinite(x)]
    if len(numbers) != 3 or len(good) != 3:
        raise InputError(f"{what}: {str(value)[:60]} is not a position (x, y, z)")
    return (float(good[0]), float(good[1]), float(good[2]))
