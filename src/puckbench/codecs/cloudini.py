from __future__ import annotations

from functools import cached_property
from importlib.metadata import version
from importlib.util import find_spec

from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.rates import lengths, parameters_of
from puckbench.codecs.registry import CODECS
from puckbench.codecs.storage.cloudini import MAGIC, decode_cloudini, encode_cloudini
from puckbench.codecs.storage.steps import MOST_STEPS

CODE = (
    *("puckbench.codecs.storage.cloudini", "puckbench.codecs.storage.steps"),
    "puckbench.codecs.most_points",
)


@CODECS.register("cloudini")
class Cloudini(Codec):
    """The codec is Cloudini, which compresses differences of successive points by Zstandard.

    It is run through the package pureini, and keeps the order of points. A rate is the resolution
    of coordinates.
    """

    rates = lengths()
    magic = MAGIC

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        most_m = MOST_STEPS * parameters_of(self, rate)["step_m"]
        missing = "pureini (GPL-3.0) not installed: pip install 'puckbench[cloudini]'"
        lack = None if find_spec("pureini") else missing
        return super().skip(cloud, rate) or cloud.wider_than(most_m) or lack

    @cached_property
    def version(self) -> str:
        return f"pureini {version('pureini')}" if find_spec("pureini") else ""

    def load(self) -> None:
        import pureini  # noqa: F401

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        return encode_cloudini(cloud.xyz, float(parameters_of(self, rate)["step_m"]))

    def decode(self, stream: bytes) -> PointCloud:
        return PointCloud(decode_cloudini(stream))
