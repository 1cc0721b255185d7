from __future__ import annotations

import shutil
import subprocess
from functools import cached_property
from typing import Any

from gpcc.grid import InputGrid, input_coordinates, quantise, unwrap
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.external import ExternalCodec, folder, read_points, write_points
from puckbench.codecs.gpcc import GridCodec, GridOptions, scale_of
from puckbench.codecs.rates import Parameters
from puckbench.codecs.registry import CODECS

CODE = ("puckbench.codecs.external", "puckbench.codecs.gpcc")

PROFILES: dict[str, tuple[str, ...]] = {
    "minimal": (
        "--planarEnabled=0",
        "--qtbtEnabled=0",
        "--inferredDirectCodingMode=0",
        "--intra_pred_max_node_size_log2=0",
        "--neighbourAvailBoundaryLog2=8",
        "--partitionMethod=0",
        "--enforceLevelLimits=0",
    ),
    "ctc": (
        "--planarEnabled=1",
        "--maxNumQtBtBeforeOt=4",
        "--minQtbtSizeLog2=0",
        "--planarModeIdcmUse=0",
        "--intra_pred_max_node_size_log2=6",
        "--neighbourAvailBoundaryLog2=8",
    ),
    "defaults": (),
}
PROFILES["spinning"] = (
    *PROFILES["ctc"],
    "--maxNumQtBtBeforeOt=6",
    "--planarModeIdcmUse=32",
    "--planarBufferDisabled=1",
)
"""Options of the program for each set of coding tools; other options keep their defaults."""


class Tmc13Options(GridOptions):
    program: str = "tmc3"


@CODECS.register("tmc13")
class Tmc13(ExternalCodec, GridCodec):
    """The codec runs MPEG's program ``tmc3``, which can decode streams of `Gpcc` and vice versa."""

    Options = Tmc13Options
    options: Tmc13Options

    @property
    def programs(self) -> tuple[str, ...]:
        return (self.options.program,)

    @cached_property
    def version(self) -> str:
        if shutil.which(self.options.program) is None:
            return ""
        said = subprocess.run([*self.programs, "--help"], capture_output=True, check=False).stdout
        return said.decode(errors="replace").partition("\n")[0]

    def _code(self, points: Floats, grid: InputGrid, parameters: Parameters, *_: Any) -> bytes:
        scale = scale_of(parameters)
        with folder() as at:
            if self.options.rounding == "truncate":  # the program itself truncates
                write_points(at / "in.ply", (points - grid.offset) / grid.unit, "float64")
                scaling = [f"--positionQuantizationScale={scale!r}"]
            else:
                positions, origin = quantise(points, grid, scale, self.options.rounding)
                write_points(at / "in.ply", positions + origin, "float64")
                scaling = ["--positionQuantizationScale=1", f"--externalScale={1 / scale!r}"]
            tools = [f"--mergeDuplicatedPoints={int(self._merges(parameters))}"]
            if self.options.profile == "spinning":
                tools.append(f"--inferredDirectCodingMode={1 if self._loses(parameters) else 3}")
            command = (
                *(*self.programs, "--mode=0", "--disableAttributeCoding=1", *tools),
                *(*PROFILES[self.options.profile], *scaling),
                f"--uncompressedDataPath={at / 'in.ply'}",
                f"--compressedStreamPath={at / 'out.bin'}",
            )
            self.run(command, at / "in.ply")
            return read_bytes(at / "out.bin")

    def decode(self, stream: bytes) -> PointCloud:
        bare, grid = unwrap(stream)
        with folder() as at:
            (at / "in.bin").write_bytes(bare)
            command = (
                *(*self.programs, "--mode=1", "--outputBinaryPly=1"),
                f"--compressedStreamPath={at / 'in.bin'}",
                f"--reconstructedDataPath={at / 'out.ply'}",
            )
            self.run(command, at / "in.bin")
            units = read_points(at / "out.ply", self.programs[0])
        return PointCloud(input_coordinates(units, grid))
