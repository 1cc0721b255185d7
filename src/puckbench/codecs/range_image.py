from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

from pydantic import Field

from pointkit.coding.framing import Framing
from pointkit.lidar.returns import Returns
from pointkit.models import Model
from puckbench.codecs.base import Availability, Pace, Parameters, lengths
from puckbench.codecs.returns_codec import ReturnsCodec, step_in_quanta
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
    metric_rates = lengths(100, 50, 20, 10, 4, 2)
    pace = Pace(0.05, 10.0)

    @abstractmethod
    def _image_encoded(self, image: Image, quanta: int) -> bytes: ...

    @abstractmethod
    def _image_decoded(self, stream: bytes, shape: tuple[int, int], quanta: int) -> Image: ...

    def available(self) -> Availability:
        return Availability.of_module("imagecodecs", "imagecodecs is not installed (pip)")

    @property
    def version(self) -> str:
        """The version of imagecodecs, which determines the versions of its libraries."""
        from importlib.metadata import version

        return f"imagecodecs {version('imagecodecs')}" if self.available().ok else ""

    @property
    def attributes(self) -> tuple[str, ...]:
        return (REFLECTANCE,) if self.options.reflectivities else ()

    def _attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        return {REFLECTANCE: reflectivity_bytes(self._framing.unframed(stream)[1])}

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, self.title)

    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        quanta = step_in_quanta(returns, parameters)
        with_values = self.options.reflectivities
        body = encode_range_images(returns, quanta, self._image_encoded, with_values)
        return self._framing.framed(body)

    def _decode_returns(self, stream: bytes) -> Returns:
        return decode_range_images(self._framing.unframed(stream)[1], self._image_decoded)
