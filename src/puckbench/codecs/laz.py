from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version

import numpy as np
from pydantic import Field

from pointkit.geometry.cloud import PointCloud
from pointkit.models import Model
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.rates import lengths, parameters_of
from puckbench.codecs.registry import CODECS
from puckbench.codecs.storage.laz import MAGIC, decode_laz, encode_laz, intensity_bytes
from puckbench.codecs.storage.steps import MOST_STEPS
from puckbench.geometry.attributes import REFLECTANCE, cloud_with, coded_attributes

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

    rates = lengths()
    magic = MAGIC
    version = f"laspy {version('laspy')}, lazrs {version('lazrs')}"

    Options = LazOptions
    options: LazOptions

    @property
    def attributes(self) -> tuple[str, ...]:
        return (REFLECTANCE,) if self.options.intensities else ()

    def attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        return {REFLECTANCE: intensity_bytes(stream)}

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        most_m = MOST_STEPS * parameters_of(self, rate)["step_m"]
        return super().skip(cloud, rate) or cloud.wider_than(most_m)

    def load(self) -> None:
        import laspy  # noqa: F401
        import lazrs  # noqa: F401

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        step_m = float(parameters_of(self, rate)["step_m"])
        attributes = coded_attributes(cloud, self.attributes)
        if REFLECTANCE not in attributes:
            return encode_laz(cloud.xyz, step_m)
        return encode_laz(cloud.xyz, step_m, attributes[REFLECTANCE].astype(np.uint16))

    def decode(self, stream: bytes) -> PointCloud:
        points, intensities = decode_laz(stream)
        return cloud_with(points, {REFLECTANCE: intensities} if intensities.any() else {})
