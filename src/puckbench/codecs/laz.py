from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version

import numpy as np
from pydantic import Field

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.models import Model
from puckbench.codecs.base import Codec, Pace, Parameters, lengths
from puckbench.codecs.registry import CODECS
from puckbench.codecs.storage.laz import MAGIC, decode_laz, encode_laz, intensity_bytes
from puckbench.codecs.storage.steps import MOST_STEPS
from puckbench.geometry.attributes import REFLECTANCE, Attributes, cloud_with

CODE = (
    *("cloud_files.las", "cloud_files.las_header", "cloud_files.las_units"),
    *("puckbench.codecs.storage.laz", "puckbench.codecs.storage.steps"),
    "puckbench.codecs.most_points",
)


class LazOptions(Model):
    intensities: bool = Field(
        False, description="also code reflectances, as intensities of 16 bits without loss"
    )


@CODECS.register("laz")
class Laz(Codec):
    """The codec is LAZ, compressed LAS 1.2 with point format 0, which keeps the order of points.

    A rate is the step to whose multiples coordinates are rounded.
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

    Options = LazOptions
    options: LazOptions

    @property
    def attributes(self) -> tuple[str, ...]:
        return (REFLECTANCE,) if self.options.intensities else ()

    def _attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        return {REFLECTANCE: intensity_bytes(stream)}

    def load(self) -> None:
        import laspy  # noqa: F401
        import lazrs  # noqa: F401

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        return encode_laz(points, float(parameters["step_m"]))

    def _encode_with_attributes(
        self, points: Floats, attributes: Attributes, parameters: Parameters
    ) -> bytes:
        values = attributes[REFLECTANCE].astype(np.uint16)
        return encode_laz(points, float(parameters["step_m"]), values)

    def _decode_with_attributes(self, stream: bytes) -> PointCloud:
        points, intensities = decode_laz(stream)
        return cloud_with(points, {REFLECTANCE: intensities} if intensities.any() else {})

    def _decode(self, stream: bytes) -> Floats:
        return decode_laz(stream)[0]
