from __future__ import annotations

import hashlib
import shutil
from functools import cached_property
from pathlib import Path

from pydantic import Field

from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import PointCloud
from pointkit.models import Model
from puckbench.codecs.draco import DRACO_RATES
from puckbench.codecs.external import ExternalCodec, folder, read_points, write_points
from puckbench.codecs.rates import parameters_of
from puckbench.codecs.registry import CODECS

CODE = ("puckbench.codecs.draco", "puckbench.codecs.external")


class DracoToolOptions(Model):
    compression_level: int = Field(
        10, ge=0, le=10, description="effort; 10 gives the smallest streams"
    )
    encoder: str = "draco_encoder"
    decoder: str = "draco_decoder"


@CODECS.register("draco_cli")
class DracoCli(ExternalCodec):
    """The codec runs Draco's programs ``draco_encoder`` and ``draco_decoder``.

    Its streams have the format of `Draco`.
    """

    rates = DRACO_RATES
    Options = DracoToolOptions
    options: DracoToolOptions
    magic = b"DRACO"

    @property
    def programs(self) -> tuple[str, ...]:
        return self.options.encoder, self.options.decoder

    @cached_property
    def version(self) -> str:
        # The tools print no version.
        path = shutil.which(self.programs[0])
        digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()[:12] if path else ""
        return f"draco_encoder {digest}".strip()

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        bits = parameters_of(self, rate)["quantization_bits"]
        with folder() as at:
            write_points(at / "in.ply", cloud.xyz, "float32")
            command = (
                *(self.programs[0], "-point_cloud", "-i", at / "in.ply", "-o", at / "out.drc"),
                *(
                    "-qp",
                    str(bits),
                    "-cl",
                    str(self.options.compression_level),
                ),
            )
            self.run(command, at / "in.ply")
            return read_bytes(at / "out.drc")

    def decode(self, stream: bytes) -> PointCloud:
        if not stream.startswith(b"DRACO"):
            raise InputError("not a Draco stream")
        with folder() as at:
            (at / "in.drc").write_bytes(stream)
            self.run((self.programs[1], "-i", at / "in.drc", "-o", at / "out.ply"), at / "in.drc")
            return PointCloud(read_points(at / "out.ply", self.programs[1]))
