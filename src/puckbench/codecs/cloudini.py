from __future__ import annotations

from functools import cached_property
from importlib.metadata import version

from pointkit.geometry.cloud import Floats
from puckbench.codecs.base import Availability, Codec, Pace, Parameters, lengths
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

    title = "Cloudini"
    use = "PointCloud2 messages of ROS: quick, in their order"
    colour = "#E7298A"
    marker = "+"
    line = "--"
    rank = 150
    pace = Pace(0.02, 0.5)
    metric_rates = lengths()
    most_steps = MOST_STEPS
    magic = MAGIC

    def available(self) -> Availability:
        why = "pureini (GPL-3.0) not installed: pip install 'puckbench[cloudini]'"
        return Availability.of_module("pureini", why)

    @cached_property
    def version(self) -> str:
        return f"pureini {version('pureini')}" if self.available().ok else ""

    def load(self) -> None:
        import pureini  # noqa: F401

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        return encode_cloudini(points, float(parameters["step_m"]))

    def _decode(self, stream: bytes) -> Floats:
        return decode_cloudini(stream)
