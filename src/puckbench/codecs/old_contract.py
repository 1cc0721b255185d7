"""Adapter of codecs that were written for the contract before `encode` and `decode` took clouds.

Such a class defines `_encode(points, parameters)` and `_decode(stream)`, which work on arrays of
points, and says in several other members what it does not code. `adapted` makes a codec of the new
contract of it, and says once, on standard error, what to rename.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Self

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.returns import Returns
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.rates import (
    Parameters,
    check_metric,
    grid_fault,
    metric_rates,
    parameters_of,
)
from puckbench.geometry.attributes import RETURNS, Attributes, coded_attributes

_NEW_NAMES = {
    "_encode": "encode(cloud, rate)",
    "_decode": "decode(stream), which returns a PointCloud",
    "_encode_sharing": "encode(cloud, rate, work)",
    "shared_work": "prepare(cloud)",
    "_encode_with_attributes": "encode",
    "_decode_with_attributes": "decode",
    "_encode_returns": "encode",
    "_decode_returns": "decode",
    "_attribute_bytes": "attribute_bytes",
    "_decode_mesh": "surfaces(stream)",
    "decode_mesh": "surfaces(stream)",
    "metric_rates": "rates",
    "available": "skip(cloud, rate)",
    "check_frame": "skip",
    "takes": "skip and attributes",
    "packets_alone": "skip",
    "grid": "skip",
    "most_steps": "skip",
    "most_extent": "skip",
    "weights_of": "weights(rate)",
    "weights_files": "weights(rate)",
    "memory": "costs",
    "pace": "costs",
}
"""Members of the old contract that a class may define, and what has taken their place."""
_HOOKS = ("_encode", "_decode", "_encode_returns", "_decode_returns")
NAMES = ("Availability", "Cost", "Memory", "Pace", "Takes", "Line")
"""Names that modules with codecs of the old contract import from `puckbench.codecs.base`."""
Takes = Line = str


class Availability(NamedTuple):
    """Whether a codec can run here, and why not."""

    ok: bool
    why: str = ""

    @classmethod
    def of_module(cls, name: str, why: str) -> Self:
        from importlib.util import find_spec

        is_here = find_spec(name) is not None
        return cls(is_here, "" if is_here else why)


class Memory(NamedTuple):
    """Estimated memory: a constant in MB, and bytes per point."""

    base_mb: float = 400.0
    bytes_per_point: float = 1000.0


class Pace(NamedTuple):
    """Estimated time: a constant in s, s per million points, and the share of encoding."""

    base_s: float = 0.1
    per_million_s: float = 10.0
    encoding: float = 0.5


@cache
def adapted(codec: type[Codec]) -> type[Codec]:
    """Return a class of codecs itself or, if it is of the old contract, an adapted subclass.

    For an old class, a line on standard error says what to rename.

    Raises
    ------
    InputError
        The class overrides members of the old contract, but is derived from a codec of puckbench
        that no longer calls them.
    """
    own = [kind for kind in codec.__mro__ if not kind.__module__.startswith("puckbench.")]
    defined = {name for kind in own if issubclass(kind, Codec) for name in vars(kind)}
    is_new = bool({"encode", "decode"} & defined)
    old = [name for name in _NEW_NAMES if name in defined and not (is_new and name[0] == "_")]
    if not old:
        return codec
    hooks = [name for name in old if name in _HOOKS]
    if hooks and (codec.encode is not Codec.encode or codec.decode is not Codec.decode):
        fault = f"{codec.__name__} defines {', '.join(hooks)}, which its base class no longer calls"
        raise InputError(f"{fault}: define encode and decode")
    renamed = ", ".join(f"{name} is now {_NEW_NAMES[name]}" for name in old)
    sys.stderr.write(f"puckbench: codec {codec.__name__} has an old interface: {renamed}\n")
    has_surfaces = {"_decode_mesh", "decode_mesh"} & {*old}
    surfaces = _decoded_mesh if has_surfaces else Codec.surfaces
    if not isinstance(codec.surfaces, bool) and not has_surfaces:
        surfaces = codec.surfaces
    about: dict[str, Any] = {
        "__module__": codec.__module__,
        "__doc__": codec.__doc__,
        "surfaces": surfaces,
        "rates": {**codec.rates, **_old_metric_rates(codec)},
    }
    if costs := _old_costs(codec):
        about["costs"] = costs
    if hooks:
        about |= {"encode": _encode, "decode": _decode}
    return type(codec.__name__, (_OldContract, codec, _OldDefaults), about)


def _old_metric_rates(codec: Any) -> Mapping[str, Parameters]:
    rates = getattr(codec, "metric_rates", {})
    check_metric(rates)
    if getattr(codec, "any_length", True):
        return dict(rates)
    return {name: {**parameters, "any_length": False} for name, parameters in rates.items()}


def _old_costs(codec: Any) -> dict[str, float]:
    memory, pace = getattr(codec, "memory", ()), getattr(codec, "pace", ())
    named = (*zip(("memory_mb", "memory_bytes"), memory, strict=False),)
    return dict((*named, *zip(("base_s", "million_s", "encoding"), pace, strict=False)))


def _encode(codec: Any, cloud: PointCloud, rate: str, work: Any = None) -> Any:
    parameters = parameters_of(codec, rate)
    if cloud.returns is not None and RETURNS in codec.attributes:
        return codec.encode_returns(cloud.returns, rate)
    if attributes := coded_attributes(cloud, codec.attributes):
        return codec._encode_with_attributes(cloud.xyz, attributes, parameters)
    if work is not None:
        return codec._encode_sharing(cloud.xyz, parameters, work)
    return codec._encode(cloud.xyz, parameters)


def _decode(codec: Any, stream: bytes) -> PointCloud:
    if hasattr(codec, "_decode_returns"):
        returns: Returns = codec._decode_returns(stream)
        return PointCloud(returns.points(), returns=returns)
    cloud: PointCloud | None = codec._decode_with_attributes(stream)
    return PointCloud(codec._decode(stream)) if cloud is None else cloud


def _decoded_mesh(codec: Any, stream: bytes) -> Mesh:
    mesh: Mesh = codec.decode_mesh(stream)
    return mesh


class _OldContract(Codec):
    """First base of adapted classes, which asks members of the old contract too."""

    def __init__(
        self, name: str, rates: Mapping[str, Parameters] | None = None, **options: Any
    ) -> None:
        super().__init__(name=name, rates=rates, **options)
        old: Any = self
        old.metric_rates = metric_rates(self.rates)

    @property
    def attributes(self: Any) -> tuple[str, ...]:
        named: tuple[str, ...] = super().attributes
        return named if self.takes == "points" or RETURNS in named else (*named, RETURNS)

    def skip(self: Any, cloud: CloudKind, rate: str) -> str | None:
        if reason := super().skip(cloud, rate):
            return reason
        if self.takes == "returns" and not cloud.has_returns:
            return "codes the returns of a spinning sensor, and the cloud has none"
        if self.packets_alone and not cloud.has_packets:
            return "codes recorded data packets"
        if self.grid and (reason := grid_fault(self, cloud.frame, rate)):
            return reason
        try:
            self.check_frame(cloud.frame, rate)
        except InputError as error:
            return str(error).removeprefix(f"codec {self.name}: ")
        ok, why = self.available()
        return cloud.wider_than(self.most_extent(rate)) or (None if ok else str(why))

    def weights(self: Any, rate: str) -> Path | None:
        return next(iter(self.weights_files()), None) or super().weights(rate)

    def prepare(self: Any, cloud: PointCloud) -> Any:
        return self.shared_work() or super().prepare(cloud)

    def attribute_bytes(self: Any, stream: bytes) -> Mapping[str, int]:
        return {**super().attribute_bytes(stream), **self._attribute_bytes(stream)}


class _OldDefaults:
    """Last base of adapted classes, with what remains of the defaults of the old contract."""

    metric_rates: Mapping[str, Parameters] = {}
    takes = "points"
    packets_alone = False
    grid = 0.0
    most_steps = math.inf

    def available(self) -> Availability:
        return Availability(True)

    def check_frame(self, frame: str | None, rate: str | None = None) -> None: ...

    def most_extent(self: Any, rate: str) -> float:
        step_m = self.parameters_of(rate).get("step_m", math.inf)
        return float(self.most_steps * step_m)

    def parameters_of(self: Any, rate: str) -> Parameters:
        return parameters_of(self, rate)

    def weights_files(self) -> list[Path]:
        return []

    def shared_work(self) -> Any:
        return None

    def encode_returns(self: Any, returns: Returns, rate: str) -> Any:
        parameters = self.parameters_of(rate)
        if hasattr(self, "_encode_returns"):
            return self._encode_returns(returns, parameters)
        return self._encode(returns.points(), parameters)

    def _encode_sharing(self: Any, points: Floats, parameters: Parameters, shared: Any) -> Any:
        return self._encode(points, parameters)

    def _encode_with_attributes(
        self, points: Floats, attributes: Attributes, parameters: Parameters
    ) -> bytes:
        raise InputError("codes positions only")

    def _decode_with_attributes(self, stream: bytes) -> PointCloud | None:
        return None

    def _attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        return {}

    def decode_mesh(self: Any, stream: bytes) -> Mesh:
        mesh: Mesh = self._decode_mesh(stream)
        return mesh
