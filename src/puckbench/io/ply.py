"""PLY files (ASCII or binary): the elements of meshes and clouds, and columns of points."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import unreadable, written_whole
from puckbench.io.ply_header import check_counts

CORNERS = ("vertex_indices", "vertex_index")
"""Names that programs give to the list of a face's vertices."""


def read_elements(path: Path) -> Any:
    """Read the elements of a PLY file, by name and each with its rows as ``data``.

    Raises
    ------
    InputError
        The file is missing or damaged.
    """
    from plyfile import PlyData, PlyParseError

    check_counts(path)
    try:
        # The mapped reading of files with triangles or quads alone is tried first, for its speed.
        for size in (3, 4):
            with suppress(PlyParseError):
                return PlyData.read(
                    str(path), known_list_len={"face": dict.fromkeys(CORNERS, size)}
                )
        return PlyData.read(str(path))
    except OSError as error:
        raise unreadable(path, error) from error
    except (PlyParseError, KeyError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(f"{path}: not a readable PLY file ({error})") from error


def has_faces(path: Path) -> bool:
    """Whether the header of a PLY file announces faces."""
    try:
        with path.open("rb") as stream:
            header = stream.read(1 << 16).split(b"end_header", 1)[0]
    except OSError as error:
        raise unreadable(path, error) from error
    counts = [line.split()[2:] for line in header.splitlines() if line.startswith(b"element face")]
    return any(count != [b"0"] for count in counts)


def read_ply(path: Path) -> dict[str, NDArray[Any]]:
    """Read the properties of the vertices of a PLY file, (n,) each, by name."""
    elements = read_elements(path)
    if "vertex" not in elements:
        raise InputError(f"{path}: not a readable PLY file (no vertices)")
    rows = np.asarray(elements["vertex"].data)
    return {name: rows[name] for name in rows.dtype.names or ()}


def write_ply(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns (n,) as a binary little-endian PLY with one property of the vertices each."""
    with written_whole(path) as temporary:
        write_vertices(temporary, columns)


def write_vertices(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Like `write_ply`, to a file that its caller makes appear whole."""
    from plyfile import PlyData, PlyElement

    kinds = [(name, part.dtype) for name, part in columns.items()]
    rows = np.empty(len(next(iter(columns.values()))), dtype=kinds)
    for name, part in columns.items():
        rows[name] = part
    PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(path))
