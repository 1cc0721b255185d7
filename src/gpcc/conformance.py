"""Tests of G-PCC decoders with conformance streams that TMC13, the reference software, encoded.

`vectors/manifest.json` holds each stream's options and the SHA-256 of the decoded points: sorted
rows of x, y, z (in `vectors/attributes` also red, green, blue and reflectance), as little-endian
float64.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.cloud import decode_cloud
from pointkit.errors import InputError
from pointkit.files import read_bytes, read_json
from pointkit.geometry.cloud import Floats

FOLDER = Path(__file__).parent / "vectors"

Values = NDArray[Any]
Decode = Callable[[bytes], Floats]
"""Function from bytes to rows of x, y, z and, if coded, red, green, blue and reflectance."""


@dataclass(frozen=True)
class ConformanceStream:
    """A stream that TMC13, the reference software, encoded, and the right result of decoding it.

    Attributes
    ----------
    name
        Name of the stream in the manifest of its folder.
    path
        File that holds the stream.
    options
        Command-line options with which TMC13 encoded the stream.
    points
        Number of decoded points.
    digest
        Result of the function `digest` for the decoded points and attributes.
    """

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
        """Number of values of a decoded point: coordinates and attribute values."""
        colours = "--attribute=color" in self.options
        return 3 + 3 * colours + ("--attribute=reflectance" in self.options)


@dataclass(frozen=True)
class Verdict:
    """Result of decoding one conformance stream: whether the decoder was right.

    Attributes
    ----------
    stream
        The stream that was decoded.
    outcome
        ``decoded`` if the points are right, ``refused`` if the decoder reported an error,
        ``failed`` if the points are wrong or the decoder crashed.
    why
        Reason in words; empty if the outcome is ``decoded``.
    """

    stream: ConformanceStream
    outcome: str
    why: str = ""


class CrashError(Exception):
    """Exception of a decoder that was ended by a signal or exceeded the time limit."""


def conformance_streams(folder: Path = FOLDER) -> list[ConformanceStream]:
    """Return the conformance streams of a folder.

    Parameters
    ----------
    folder
        Folder with a ``manifest.json`` and the streams (``.bin``). By default, it is the folder
        ``vectors`` of this package. Streams of a subfolder ``attributes`` are included.

    Returns
    -------
    list of ConformanceStream
        The streams that the manifest lists.

    Raises
    ------
    InputError
        There is no manifest, or it does not list streams.
    """
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
    """Return the SHA-256 (hexadecimal) of points, whose order does not matter.

    Parameters
    ----------
    points
        Rows (n, columns), which are sorted by their columns before they are hashed.
    """
    ordered = points[np.lexsort(points.T[::-1])] + 0.0  # no negative zeros
    return hashlib.sha256(ordered.astype("<f8").tobytes()).hexdigest()


def verdicts(decode: Decode, streams: Sequence[ConformanceStream]) -> Iterator[Verdict]:
    """Decode conformance streams with any decoder, and yield a verdict for each stream.

    Parameters
    ----------
    decode
        Decoder: a function that takes the bytes of a stream, and returns an array (m, 3 to 7) of x,
        y and z, then red, green, blue and reflectance if the stream has them. It may raise
        `InputError` to refuse a stream, and `CrashError`.
    streams
        The streams, as `conformance_streams` returns them.

    Yields
    ------
    Verdict
        Whether the decoder was right.
    """
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
    """Decode a stream with this package to the rows that `verdicts` compares.

    Parameters
    ----------
    stream
        A G-PCC stream.

    Returns
    -------
    ndarray
        float64 (m, 3 to 7): x, y, z, then red, green, blue and reflectance if the stream has them.
    """
    cloud = decode_cloud(stream)
    values = [cloud.attributes.get(name) for name in ("color", "reflectance")]
    return rows_of(cloud.positions(), *values)


def rows_of(points: Floats, colours: Values | None, reflectances: Values | None) -> Floats:
    """Return points (n, 3) with colours (n, 3) and reflectances (n,) as columns of one array.

    Colours or reflectances that are None are left out.
    """
    columns = (points, colours, reflectances)
    return np.column_stack([each for each in columns if each is not None]).astype(np.float64)
