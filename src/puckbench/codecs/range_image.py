from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from importlib.util import find_spec

from pydantic import Field

from pointkit.coding.framing import Framing
from pointkit.geometry.cloud import PointCloud
from pointkit.models import Model
from puckbench.codecs.base import CloudKind
from puckbench.codecs.rates import lengths
from puckbench.codecs.returns_codec import ReturnsCodec, cloud_of, returns_of
from puckbench.codecs.storage.range_images import (
    Image,
    decode_range_images,
    encode_range_images,
    reflectivity_bytes,
)
from puckbench.geometry.attributes import REFLECTANCE

CODE = (
    *("puck.returns_header", "pointkit.lidar.sensors", "puckbench.codecs.most_points"),
    *("puckbench.codecs.returns_codec", "puckbench.codecs.storage.range_images"),
)


class RangeImageOptions(Model):
    reflectivities: bool = Field(
        False, description="also code the reflectivities of returns, as images without loss"
    )


class RangeImageCodec(ReturnsCodec):
    """Base class of codecs that compress the range images of a spinning sensor by an image format.

    A range image has a row for each laser and a column for each firing. A rate is the step to which
    ranges are rounded. The sensor's range resolution is lossless.
    """

    Options: type[RangeImageOptions] = RangeImageOptions
    options: RangeImageOptions
    rates = lengths(100, 50, 20, 10, 4, 2)

    @abstractmethod
    def _image_encoded(self, image: Image, quanta: int) -> bytes: ...

    @abstractmethod
    def _image_decoded(self, stream: bytes, shape: tuple[int, int], quanta: int) -> Image: ...

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        missing = None if find_spec("imagecodecs") else "imagecodecs is not installed (pip)"
        return super().skip(cloud, rate) or missing

    @property
    def version(self) -> str:
        """The version of imagecodecs, which determines the versions of its libraries."""
        from importlib.metadata import version

        return f"imagecodecs {version('imagecodecs')}" if find_spec("imagecodecs") else ""

    def attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        return {REFLECTANCE: reflectivity_bytes(self._framing.unframed(stream)[1])}

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, f"{self.name} range-image")

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        returns = returns_of(cloud)
        quanta = self.step_in_quanta(returns, rate)
        with_values = self.options.reflectivities
        body = encode_range_images(returns, quanta, self._image_encoded, with_values)
        return self._framing.framed(body)

    def decode(self, stream: bytes) -> PointCloud:
        body = self._framing.unframed(stream)[1]
        return cloud_of(decode_range_images(body, self._image_decoded))
