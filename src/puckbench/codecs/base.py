"""The interface of codecs: a class with rates, `_encode` and `_decode`, registered by name.

`puckbench.codecs.facts` defines the properties that plans, tables and figures use. A user's codec
is one file::

    from puckbench.codecs.base import Codec
    from puckbench.codecs.registry import CODECS

    @CODECS.register("raw")
    class Raw(Codec):
        title = "Raw floats"
        rates = {"r1": {"kind": "<f2"}, "r2": {"kind": "<f4"}}

        def _encode(self, points, parameters):
            return parameters["kind"].encode() + points.astype(parameters["kind"]).tobytes()

        def _decode(self, stream):
            return np.frombuffer(stream[3:], stream[:3].decode()).reshape(-1, 3).astype(float)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import Floats, PointCloud, check_points
from pointkit.geometry.mesh import Mesh, labelled_mesh_in_metres
from pointkit.measurement import NO_COST, Cost
from puckbench.codecs.facts import CodecFacts, Line, Memory, Pace, Parameters, Takes, lengths
from puckbench.codecs.shift import moved, shift_of, shifted, unshifted
from puckbench.geometry.attributes import Attributes, attributes_of, check_attributes

if TYPE_CHECKING:
    from pointkit.lidar.returns import Returns

CODE = (
    "puckbench.codecs.facts",
    "puckbench.codecs.shift",
    "puckbench.codecs.unit",
    "puckbench.geometry.attributes",
)

__all__ = [
    "Availability",
    "Codec",
    "CodecFacts",
    "Cost",
    "Line",
    "Memory",
    "Pace",
    "Parameters",
    "SharedWork",
    "Takes",
    "lengths",
]


class Availability(NamedTuple):
    """The answer to whether a codec can run on this machine.

    Parameters
    ----------
    ok
        Whether the codec can run.
    why
        The reason in one line if it cannot, else empty.
    """

    ok: bool
    why: str = ""

    @classmethod
    def of_module(cls, name: str, why: str) -> Self:
        """Tell whether a Python module is installed.

        Parameters
        ----------
        name
            Name of the module.
        why
            The reason to give if it is not installed.
        """
        is_here = find_spec(name) is not None
        return cls(is_here, "" if is_here else why)


class SharedWork(Protocol):
    """An object that holds intermediate results of a cloud, which all rates share.

    The first encoding of the cloud stores the results. Encodings at other rates reuse them.
    """

    saved: Cost = NO_COST
    """Cost of computing the results that the last encoding reused."""


class Codec(CodecFacts, ABC):
    """Base class of all codecs, which encode a point cloud to a byte string and decode it.

    A subclass must define `rates`, `_encode` and `_decode`; other members have defaults. The byte
    string (stream) contains all that the decoder needs. Results must depend only on the arguments
    of a call. When a run is planned, the subclass's module is imported, so slow packages should be
    imported inside methods.
    """

    magic: bytes = b""
    """First bytes of the codec's streams, by which `codec_of` recognises them."""
    bare_magic: bytes = b""
    """First bytes of streams without puckbench's wrapper, which hint at the codec but do not
    identify it."""
    shifts_far_clouds: bool = True
    """Whether a cloud far from the origin is shifted towards it before encoding
    (`codecs.shift`)."""
    is_single_precision: ClassVar[bool] = False
    """Whether coordinates are coded in single precision, which resolves fine steps only near the
    origin."""

    @property
    def has_surfaces(self) -> bool:
        """Whether `decode_mesh` can decode streams to triangles."""
        return type(self)._decode_mesh is not Codec._decode_mesh

    def available(self) -> Availability:
        """Return whether the codec can run on this machine and, if not, the reason."""
        return Availability(True)

    def load(self) -> None:
        """Prepare the codec before timed calls: load weights and compile functions."""

    def cost(self, here: Cost) -> Cost:
        """Return the time and memory that the last encoding or decoding took.

        Parameters
        ----------
        here
            Cost of the call, measured in this process.

        Returns
        -------
        Cost
            The cost of the external programs if the codec runs any, else `here`.
        """
        return here

    def shared_work(self) -> SharedWork | None:
        """Return a new, empty object for results that all rates of one cloud share, or None.

        None means that the codec has no such results. The caller passes the object to `encode` for
        each rate; a subclass uses it in `_encode_sharing`.
        """
        return None

    def encode_cloud(self, cloud: PointCloud, rate: str, shared: SharedWork | None = None) -> bytes:
        """Encode a cloud at a rate to a self-contained byte string.

        The sensor's returns are encoded instead of the points if the codec uses returns and the
        cloud has them. Attributes of the cloud that are listed in the codec's `attributes` are
        encoded too.

        Parameters
        ----------
        cloud
            The cloud to encode.
        rate
            Name of a rate, as in `encode`.
        shared
            Object from `shared_work` for this cloud. It is not used for returns or attributes.

        Raises
        ------
        InputError
            As for `encode`. Also if the rate is for clouds in another coordinate frame, or if the
            codec requires returns and the cloud has none. Points of unknown frame are taken as
            metres if the rate is a length.
        """
        if not isinstance(cloud, PointCloud):
            fault = f"a PointCloud is coded, not {type(cloud).__name__} (points: encode)"
            raise InputError(f"codec {self.name}: {fault}")
        if cloud.frame or self.rate_name(rate) in self.rates:
            self.check_frame(cloud.frame, rate)
        if self.takes == "points" or (self.takes == "either" and cloud.returns is None):
            held = attributes_of(cloud) if self.attributes else {}
            if attributes := {name: held[name] for name in self.attributes if name in held}:
                return self.encode(cloud.xyz, rate, attributes=attributes)
            more = () if shared is None else (shared,)  # a user's `encode` may lack the parameter
            return self.encode(cloud.xyz, rate, *more)
        if cloud.returns is None:
            raise InputError(
                f"codec {self.name}: codes the returns of a spinning sensor, and the cloud has none"
            )
        return self.encode_returns(cloud.returns, rate)

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        """Encode the returns (range measurements) of a spinning sensor at a rate to a byte string.

        By default, the points of the returns are encoded. Raises InputError as `encode` does.
        """
        return self.encode(returns.points(), rate)

    def decode_cloud(self, stream: bytes) -> PointCloud:
        """Decode a byte string to a cloud, with the returns and attributes that it contains.

        Raises InputError if the byte string is damaged or belongs to another codec.
        """
        with naming(f"codec {self.name}"):
            content, shift = unshifted(stream)
            cloud = self._decode_with_attributes(content)
        if cloud is None:
            points = self.decode(stream)
            with naming(f"codec {self.name}: decoded points"):
                return PointCloud(points)
        return cloud if shift is None else replace(cloud, xyz=moved(cloud.xyz, shift))

    def attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        """Return how many bytes of a stream each attribute takes, by name of the attribute.

        All other bytes are geometry. Attributes without bytes are left out.
        """
        with naming(f"codec {self.name}"):
            sizes = self._attribute_bytes(unshifted(stream).stream)
        return {name: size for name, size in sizes.items() if size}

    def encode(
        self,
        points: Floats,
        rate: str,
        shared: SharedWork | None = None,
        attributes: Attributes | None = None,
    ) -> bytes:
        """Encode points at a rate to a self-contained byte string.

        Parameters
        ----------
        points
            Coordinates (n, 3).
        rate
            Name of a rate in `rates` or `metric_rates`, or a length such as "15mm" if the codec
            allows any.
        shared
            Object from `shared_work` for this cloud. It saves time and does not affect the result.
        attributes
            Values of the points by attribute name. The codec's `attributes` lists the possible
            names.

        Raises
        ------
        InputError
            The rate is unknown, the cloud is empty, a coordinate is not finite, or a reflectance is
            not a 16-bit integer.
        """
        parameters = self.parameters_of(rate)
        check_points(points, f"codec {self.name}")
        points = np.ascontiguousarray(points, dtype=np.float64)
        step = parameters.get("step_m") if self.is_single_precision else None
        shift = shift_of(points, step) if self.shifts_far_clouds else None
        points = points if shift is None else points - shift
        with naming(f"codec {self.name}"):
            if attributes:
                check_attributes(attributes, len(points))
                stream = self._encode_with_attributes(points, attributes, parameters)
            elif shared is None:
                stream = self._encode(points, parameters)
            else:
                shared.saved = NO_COST
                stream = self._encode_sharing(points, parameters, shared)
            if not isinstance(stream, bytes):
                raise InputError(f"_encode returned {type(stream).__name__}, not bytes")
            if not stream:
                raise InputError("_encode returned an empty stream")
        return stream if shift is None else shifted(stream, shift)

    def decode(self, stream: bytes) -> Floats:
        """Decode a byte string to points (m, 3), in the coordinate frame of the encoded cloud.

        The order of the points is arbitrary. Raises InputError if the byte string is damaged or
        belongs to another codec.
        """
        with naming(f"codec {self.name}"):
            content, shift = unshifted(stream)
            points = self._decode(content)
            if getattr(points, "shape", (0, 0))[1:] != (3,):
                raise InputError(f"_decode returned {_described(points)}")
        return points if shift is None else moved(points, shift)

    def decode_mesh(self, stream: bytes) -> Mesh:
        """Decode a byte string to a triangulated surface in the coordinates of the encoded cloud.

        Returns
        -------
        Mesh
            Triangles that are labelled with primitives and objects (`pointkit.geometry.mesh`). An
            object may consist of several primitives.

        Raises
        ------
        InputError
            As for `decode`. Also if the codec or the byte string has no surfaces.
        """
        with naming(f"codec {self.name}"):
            content, shift = unshifted(stream)
            mesh = self._decode_mesh(content)
        return mesh if shift is None else labelled_mesh_in_metres(mesh, 1.0, shift)

    def _decode_mesh(self, stream: bytes) -> Mesh:
        """Decode the surfaces of a stream; raise InputError as `_decode` does."""
        raise InputError("codes points, not surfaces")

    def _encode_sharing(self, points: Floats, parameters: Parameters, shared: Any) -> bytes:
        """Encode as `_encode` does, but store or reuse results in an object from `shared_work`.

        A subclass sets `shared.saved` to the cost of the reused results.
        """
        return self._encode(points, parameters)

    def _encode_with_attributes(
        self, points: Floats, attributes: Attributes, parameters: Parameters
    ) -> bytes:
        """Encode points and their attributes: arrays (n,) or (n, 3) by name."""
        raise InputError("codes positions only")

    def _decode_with_attributes(self, stream: bytes) -> PointCloud | None:
        """Decode points and attributes, or return None if the stream has no attributes."""
        return None

    def _attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        return {}

    @abstractmethod
    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        """Encode finite points (n, 3), n >= 1, with a rate's parameters to non-empty bytes."""

    @abstractmethod
    def _decode(self, stream: bytes) -> Floats:
        """Decode points (m, 3); raise InputError if the stream is damaged or from another codec."""


def _described(value: object) -> str:
    shape = getattr(value, "shape", None)
    what = type(value).__name__ if shape is None else f"an array of shape {shape}"
    return f"{what}, not an array of shape (m, 3)"
