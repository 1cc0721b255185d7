"""Functions that call codecs: they check what goes in and comes out, and shift far clouds."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import chdir
from dataclasses import replace
from typing import Any

import numpy as np

from pointkit.errors import InputError, error_text, naming
from pointkit.geometry.cloud import CoordinateFrame, PointCloud, check_points
from pointkit.geometry.mesh import Mesh, labelled_mesh_in_metres
from pointkit.measurement import NO_COST, Cost
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.external import ExternalCodec
from puckbench.codecs.rates import (
    budget_of,
    is_length,
    offered_rates,
    parameters_of,
    rates_of,
)
from puckbench.codecs.shift import moved, shift_of, shifted, unshifted
from puckbench.geometry.attributes import RETURNS

CODE = ("puckbench.codecs.external",)


def encoded(codec: Codec, cloud: PointCloud, rate: str, work: Any = None) -> bytes:
    """Encode a cloud to a self-contained byte string.

    Arguments and errors are those of `puckbench.encoded`, which also takes arrays of points.
    """
    name = f"codec {codec.name}"
    if not isinstance(cloud, PointCloud):
        raise InputError(f"{name}: a PointCloud is coded, not {type(cloud).__name__}")
    parameters_of(codec, rate)
    check_points(cloud.xyz, name)
    kind = CloudKind.of(cloud)
    if kind.frame is None and is_length(codec, rate):
        kind = kind._replace(frame="metric")
    if reason := skip_reason(codec, kind, rate):
        raise InputError(f"{name}: {reason}")
    shift = None if _is_coded_as_it_is(codec, cloud) else shift_of(cloud.xyz)
    points = cloud.xyz if shift is None else cloud.xyz - shift
    points = np.ascontiguousarray(points, dtype=np.float64)
    if points is not cloud.xyz:
        cloud = replace(cloud, xyz=points)
    _forget_programs(codec)
    if work is not None:
        work.saved = NO_COST
    with naming(name), chdir("."):  # and back, if the codec changes the folder
        stream = codec.encode(cloud, rate) if work is None else codec.encode(cloud, rate, work)
        if not isinstance(stream, bytes):
            raise InputError(f"encode returned {type(stream).__name__}, not bytes")
        if not stream:
            raise InputError("encode returned an empty stream")
    return stream if shift is None else shifted(stream, shift)


def _is_coded_as_it_is(codec: Codec, cloud: PointCloud) -> bool:
    """Return whether a cloud must not be shifted: returns have no place, bare streams no header."""
    has_returns = cloud.returns is not None and RETURNS in codec.attributes
    return has_returns or getattr(codec.options, "raw", False)


def decoded(codec: Codec, stream: bytes) -> PointCloud:
    """Decode a byte string to a cloud, in the coordinate frame of the encoded cloud.

    The cloud has the returns and attributes that the byte string contains. Raises InputError if the
    byte string is damaged or belongs to another codec.
    """
    _forget_programs(codec)
    with naming(f"codec {codec.name}"), chdir("."):
        content, shift = unshifted(stream)
        cloud = codec.decode(content)
        if not isinstance(cloud, PointCloud):
            raise InputError(f"decode returned {type(cloud).__name__}, not a PointCloud")
        return cloud if shift is None else replace(cloud, xyz=moved(cloud.xyz, shift))


def decoded_surfaces(codec: Codec, stream: bytes) -> Mesh:
    """Decode a byte string to a triangulated surface (see `Codec.surfaces`).

    Raises InputError as `decoded` does, and if the codec or the byte string has no surfaces.
    """
    with naming(f"codec {codec.name}"), chdir("."):
        content, shift = unshifted(stream)
        mesh = codec.surfaces(content)
    return mesh if shift is None else labelled_mesh_in_metres(mesh, 1.0, shift)


def attribute_bytes(codec: Codec, stream: bytes) -> Mapping[str, int]:
    """Return how many bytes of a stream each attribute takes, by name of the attribute.

    All other bytes are geometry. Attributes without bytes are left out.
    """
    with naming(f"codec {codec.name}"):
        content = unshifted(stream).stream
        sizes = codec.attribute_bytes(content)
        if min(sizes.values(), default=0) < 0 or sum(sizes.values()) > len(content):
            raise InputError(f"attribute_bytes returned {dict(sizes)}, of {len(content)} bytes")
    return {name: size for name, size in sizes.items() if size}


def check_codes(codec: Codec, cloud: CloudKind, rate: str | None = None) -> None:
    """Raise InputError if a codec skips a cloud at a rate; by default, at each rate for its frame.

    The message has the codec's reason (`Codec.skip`).
    """
    rates = (rate,) if rate is not None else tuple(rates_of(codec, cloud.frame) or codec.rates)
    reasons = [skip_reason(codec, cloud, each) for each in rates]
    if reasons and all(reasons):
        raise InputError(f"codec {codec.name}: {reasons[0]}")


def skip_reason(codec: Codec, cloud: CloudKind, rate: str) -> str | None:
    """Return why a codec does not encode a cloud at a rate (`Codec.skip`), or None.

    At a budget, a codec encodes what it encodes at one of its rates or more. Raises InputError if
    `skip` raises an exception, or returns neither a text nor None.
    """
    if budget_of(codec, rate):
        offered = offered_rates(codec, cloud.frame) or codec.rates
        reasons = [skip_reason(codec, cloud, each) for each in offered]
        return reasons[0] if all(reasons) else None
    with naming(f"codec {codec.name}: skip({cloud}, {rate!r})"):
        try:
            reason = codec.skip(cloud, rate)
        except (AttributeError, TypeError, ValueError) as error:
            raise InputError(error_text(error)) from error
        if not isinstance(reason, str | None):
            raise InputError(f"returned {type(reason).__name__}, not a text or None")
    return reason


def why_not_here(codec: Codec) -> str:
    """Return why a codec cannot encode on this machine, or "" if it can.

    It cannot if it skips a rate for every cloud, since a package, program or file is missing.
    """
    return next(filter(None, (_lack(codec, rate) for rate in codec.rates)), "")


def skip_anywhere(codec: Codec, cloud: CloudKind, rate: str) -> str | None:
    """Return why a codec does not encode a cloud on any machine, or None.

    This is `Codec.skip` without what only this machine lacks: a planned job may run on another.
    """
    reason = skip_reason(codec, cloud, rate)
    return None if reason == _lack(codec, rate) else reason


def _lack(codec: Codec, rate: str) -> str | None:
    """Return why a codec skips a rate for every cloud, or None if it encodes some."""
    if budget_of(codec, rate):
        return why_not_here(codec) or None
    frame: CoordinateFrame = "metric" if is_length(codec, rate) else "scaled"
    return skip_reason(codec, CloudKind(frame, has_returns=True, has_packets=True), rate)


def cost_of(codec: Codec, here: Cost) -> Cost:
    """Return the time and memory that the last encoding or decoding took.

    It is the cost of the external programs that the codec ran, or else `here`, which was measured
    in this process.
    """
    programs = codec.programs_cost if isinstance(codec, ExternalCodec) else None
    return programs or here


def _forget_programs(codec: Codec) -> None:
    if isinstance(codec, ExternalCodec):
        codec.programs_cost = None
