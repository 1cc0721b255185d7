from __future__ import annotations

from pydantic import Field

from puckbench import __version__
from puckbench.codecs.base import Codec, Pace, Parameters, lengths
from puckbench.codecs.registry import CODECS
from puckbench.coding.framing import Framing
from puckbench.core.errors import naming
from puckbench.core.models import Model
from puckbench.geometry.cloud import Floats
from puckbench.storage.point_differences import decode_differences, encode_differences
from puckbench.storage.steps import MOST_STEPS


class DeltaZstdOptions(Model):
    level: int = Field(19, ge=1, le=22, description="level of Zstandard; Cloudini uses 1")


@CODECS.register("delta_zstd")
class DeltaZstd(Codec):
    """Differences between successive points, compressed by Zstandard (the scheme of Cloudini).

    The order of the points is kept. A rate is the step to which coordinates are rounded.
    """

    title = "Delta + Zstandard"
    use = "PointCloud2 messages: quick, in their order (the scheme of Cloudini)"
    colour = "#E7298A"
    marker = "+"
    line = "--"
    rank = 150
    pace = Pace(0.02, 2.0)
    metric_rates = lengths()
    most_steps = MOST_STEPS
    Options = DeltaZstdOptions
    options: DeltaZstdOptions
    magic = b"PBDZ"
    version = f"puckbench {__version__}"

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, self.title)

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        with naming(f"codec {self.name}"):
            step = float(parameters["step_m"])
            return self._framing.framed(encode_differences(points, step, self.options.level))

    def _decode(self, stream: bytes) -> Floats:
        with naming(f"codec {self.name}"):
            return decode_differences(self._framing.unframed(stream)[1])
