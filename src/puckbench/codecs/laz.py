from __future__ import annotations

from importlib.metadata import version

from puckbench.codecs.base import Codec, Pace, Parameters, lengths
from puckbench.codecs.registry import CODECS
from puckbench.core.errors import naming
from puckbench.geometry.cloud import Floats
from puckbench.storage.laz import MAGIC, decode_laz, encode_laz
from puckbench.storage.steps import MOST_STEPS


@CODECS.register("laz")
class Laz(Codec):
    """LAZ (LAS 1.2, point format 0), which keeps the order of points.

    A rate is the step to which coordinates are rounded.
    """

    title = "LAZ"
    use = "what surveyors' programs read"
    colour = "#66A61E"
    marker = "3"
    line = "--"
    rank = 160
    pace = Pace(0.05, 1.5)
    metric_rates = lengths()
    most_steps = MOST_STEPS
    magic = MAGIC
    version = f"laspy {version('laspy')}, lazrs {version('lazrs')}"

    def load(self) -> None:
        import laspy  # noqa: F401
        import lazrs  # noqa: F401

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        with naming(f"codec {self.name}"):
            return encode_laz(points, float(parameters["step_m"]))

    def _decode(self, stream: bytes) -> Floats:
        with naming(f"codec {self.name}"):
            return decode_laz(stream)
