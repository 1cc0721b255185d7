from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cloud_files.clouds import cloud_bytes
from pointkit.errors import naming
from puckbench.core.archives import write_archive
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.results.curves import read_curve
from puckbench.steps.coding import (
    CodecStep,
    TimingSettings,
    decoded_cloud,
    planned_codec_step,
    ready,
)
from puckbench.steps.step import STEPS, PlannedStep

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*CLOUD_FILES, *CODEC)


@STEPS.register("decode_shown")
class DecodeShown(CodecStep):
    """Decode a cloud at the rates that the report shows.

    `rates` are the names of these rates.
    """

    rates: tuple[str, ...]

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str, codec: str) -> PlannedStep:
        rates = flow.plan.shown_rates(dataset, cloud, codec)
        entry = flow.plan.coding_entry(dataset, codec, rates)
        inputs = {"curve": flow.files.curve(dataset, cloud, codec)}
        return planned_codec_step(flow, cls(codec=codec, entry=entry, rates=rates), inputs)

    def run(self, curve: Path, clouds: Path) -> dict[str, Any]:
        """Write the decoded clouds to one ZIP file, as ``RATE.ply``, and return their number."""
        write_archive(clouds, self._decoded(curve))
        return {"clouds": len(self.rates)}

    def _decoded(self, curve: Path) -> Iterator[tuple[str, bytes]]:
        coded, codec = read_curve(curve), ready(self.opened())
        once = TimingSettings(repeats=1)
        with naming(curve):
            for rate in self.rates:
                yield f"{rate}.ply", cloud_bytes(decoded_cloud(codec, coded[rate], once).cloud)
