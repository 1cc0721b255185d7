"""Tests of G-PCC decoders with conformance streams from TMC13.

`vectors/manifest.json` holds each stream's options and the SHA-256 of its decoded points: sorted
rows of x, y, z (in `vectors/attributes` also red, green, blue and reflectance), as little-endian
float64.
"""

from __future__ import annotations

import hashlib
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes, read_json
from puckbench.geometry.cloud import Floats
from puckbench.gpcc.attributes.cloud import decode_cloud
from puckbench.io.clouds import read_cloud

FOLDER = Path(__file__).parent / "vectors"
SECONDS = 60
"""Time limit of a program per stream, in s."""
_REFLECTANCES = ("refc", "reflectance")

Values = NDArray[Any]
Decode = Callable[[bytes], Floats]
"""Function that returns rows of x, y, z and, if coded, red, green, blue and reflectance."""


@dataclass(frozen=True)
class ConformanceStream:
    """A stream, its TMC13 options, and the digest of its points and attributes."""

    name: str
    path: Path
    options: tuple[str, ...]
    points: int
    digest: str

    @property
    def tools(self) -> str:
        """Coding tools: `attributes`, `octree`, `trees`, `angular octree` or `angular trees`."""
        if self.columns > 3:
            return "attributes"
        kind = "trees" if "--geomTreeType=1" in self.options else "octree"
        return f"angular {kind}" if "--angularEnabled=1" in self.options else kind

    @property
    def columns(self) -> int:
        """Number of coordinates and attribute values of each point."""
        colours = "--attribute=color" in self.options
        return 3 + 3 * colours + ("--attribute=reflectance" in self.options)


@dataclass(frozen=True)
class Verdict:
    """Result of a decoder for a stream (`decoded`, `refused` or `failed`), and the reason."""

    stream: ConformanceStream
    outcome: str
    why: str = ""


class CrashError(Exception):
    """Raised if a program was ended by a signal or exceeded the time limit."""


def conformance_streams(folder: Path = FOLDER) -> list[ConformanceStream]:
    """Return the streams of a folder, and those of its subfolder `attributes`."""
    streams = _listed(folder, "")
    inner = folder / "attributes"
    return streams + _listed(inner, "attributes/") if inner.is_dir() else streams


def _listed(folder: Path, prefix: str) -> list[ConformanceStream]:
    manifest = read_json(folder / "manifest.json")
    try:
        if isinstance(manifest, list):
            manifest = {about["name"]: about for about in manifest}
        return [
            _stream(prefix + name, folder / f"{name}.bin", about)
            for name, about in sorted(manifest.items())
        ]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder / 'manifest.json'}: not a manifest of streams") from error


def _stream(name: str, path: Path, about: dict[str, Any]) -> ConformanceStream:
    listed = "decoded_sorted_float64_sha256"  # name of the digest if the manifest is a list
    return ConformanceStream(
        name,
        path,
        tuple(about["options"]),
        int(about["points_out"]),
        str(about[listed] if listed in about else about["sha256_sorted_float64"]),
    )


def digest(points: Floats) -> str:
    """Return the SHA-256 of points (n, columns), independent of their order."""
    ordered = points[np.lexsort(points.T[::-1])] + 0.0  # no negative zeros
    return hashlib.sha256(ordered.astype("<f8").tobytes()).hexdigest()


def verdicts(decode: Decode, streams: Sequence[ConformanceStream]) -> Iterator[Verdict]:
    for stream in streams:
        try:
            points = decode(read_bytes(stream.path))
        except InputError as error:
            yield Verdict(stream, "refused", str(error))
        except CrashError as error:
            yield Verdict(stream, "failed", str(error))
        else:
            if points.shape[1] < stream.columns:
                yield Verdict(stream, "refused", "no values of the attributes")
                continue
            points = points if stream.columns > 3 else points[:, :3]
            if len(points) != stream.points:
                why = f"{len(points)} points in place of {stream.points}"
                yield Verdict(stream, "failed", why)
            elif digest(points) != stream.digest:
                yield Verdict(stream, "failed", _difference(stream))
            else:
                yield Verdict(stream, "decoded")


def _difference(stream: ConformanceStream) -> str:
    return "other points or attributes" if stream.columns > 3 else "other points"


def decode_rows(stream: bytes) -> Floats:
    cloud = decode_cloud(stream)
    values = [cloud.attributes.get(name) for name in ("color", "reflectance")]
    return _rows(cloud.positions(), *values)


def _rows(points: Floats, colours: Values | None, reflectances: Values | None) -> Floats:
    columns = (points, colours, reflectances)
    return np.column_stack([each for each in columns if each is not None]).astype(np.float64)


def program_decoder(words: str) -> Decode:
    """Return a decoder that runs a program; raise InputError if the program does not exist.

    The decoder raises InputError if the program fails, `CrashError` if it crashes.

    Parameters
    ----------
    words
        Command with ``{stream}`` for the input and ``{points}`` for the output (.ply), or a program
        with the options of TMC13's ``tmc3``.
    """
    if "{stream}" not in words:
        words = f"{shlex.quote(words)} --mode=1 --compressedStreamPath={{stream}}"
        words += " --reconstructedDataPath={points}"
    command = shlex.split(words)
    if shutil.which(command[0]) is None:
        raise InputError(f"no codec and no program '{command[0]}'")

    def decode(stream: bytes) -> Floats:
        with tempfile.TemporaryDirectory(prefix="puckbench-") as folder:
            source, target = Path(folder) / "stream.bin", Path(folder) / "points.ply"
            source.write_bytes(stream)
            filled = [
                word.replace("{stream}", str(source)).replace("{points}", str(target))
                for word in command
            ]
            _run(filled)
            cloud = read_cloud(target, keep_missing=True)
            values = [cloud.fields[name] for name in _REFLECTANCES if name in cloud.fields]
            return _rows(cloud.xyz, cloud.colours, values[0] if values else None)

    return decode


def _run(command: list[str]) -> None:
    try:
        ran = subprocess.run(command, capture_output=True, check=False, timeout=SECONDS)
    except subprocess.TimeoutExpired as error:
        raise CrashError(f"did not end within {SECONDS} s") from error
    except OSError as error:
        raise InputError(f"{command[0]}: {error.strerror}") from error
    if ran.returncode < 0:
        raise CrashError(f"ended by signal {-ran.returncode}")
    if ran.returncode:
        said = (ran.stderr or ran.stdout).decode(errors="replace").strip()
        raise InputError(f"status {ran.returncode}: {said.rpartition(chr(10))[2][:80]}")
