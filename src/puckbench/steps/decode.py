from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cloud_files.clouds import write_cloud
from pointkit.errors import naming
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.results.curves import read_coded
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


@STEPS.register("decode")
class Decode(CodecStep):
    """Decode one rate of a curve to a cloud.

    `rate` is the name of the rate.
    """

    rate: str

    @classmethod
    def of_plan(
        cls, flow: Workflow, /, dataset: str, cloud: str, codec: str, rate: str
    ) -> PlannedStep:
        entry = flow.plan.coding_entry(dataset, codec, (rate,))
        inputs = {"curve": flow.files.curve(dataset, cloud, codec)}
        return planned_codec_step(flow, cls(codec=codec, entry=entry, rate=rate), inputs)

    def run(self, curve: Path, cloud: Path) -> dict[str, Any]:
        """Write the decoded cloud, and return facts about the decoding."""
        codec = ready(self.opened())
        with naming(curve):
            result = decoded_cloud(codec, read_coded(curve, self.rate), TimingSettings(repeats=1))
        write_cloud(cloud, replace(result.cloud, about={"source": curve.name, "codec": self.codec}))
        return result.record
