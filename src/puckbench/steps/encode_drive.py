from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import noting
from pointkit.measurement import Cost, measured
from pointkit.terminal import Progress
from puckbench.codecs.coding import encoded
from puckbench.codecs.rates import rates_of
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.recordings.drives import read_drive
from puckbench.results.coded_drives import CodedDrive, write_coded_drive
from puckbench.steps.coding import TimedStep, planned_codec_step, ready
from puckbench.steps.step import STEPS, PlannedStep

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *(*CLOUD_FILES, *CODEC, "cloud_files.poses", "puckbench.recordings"),
    "puckbench.results.coded_drives",
)


@STEPS.register("encode_drive")
class EncodeDrive(TimedStep):
    """Encode a drive at all rates that a codec has for clouds in metres.

    A drive is a sequence of turns (revolutions) of a moving sensor. Each turn becomes a separate
    stream.
    """

    @classmethod
    def of_plan(cls, flow: Workflow, /, drives: str, drive: str, codec: str) -> PlannedStep:
        step = cls(codec=codec, entry=flow.drives.coding_entry(drives, codec), **flow.plan.timing)
        inputs = {"drive": flow.files.drive(drives, drive)}
        return planned_codec_step(flow, step, inputs, **flow.drives.request(drives, codec))

    def run(self, drive: Path, curve: Path) -> dict[str, Any]:
        """Encode the file `drive`, write all streams to `curve`, and return the number of rates."""
        codec = ready(self.opened())
        turns = [replace(turn, fields={}) for turn in read_drive(drive).turns]  # without times
        points = sum(map(len, turns))
        rates, shared = rates_of(codec, "metric"), [codec.prepare(turn) for turn in turns]
        progress, coded = Progress("rate"), {}
        for done, rate in enumerate(rates, start=1):

            def encoded_turns(rate: str = rate) -> list[bytes]:
                each = zip(turns, shared, strict=True)
                return [encoded(codec, turn, rate, work) for turn, work in each]

            saved = _saved(shared)
            with noting(f"rate {rate}"):
                timed = measured(encoded_turns, self.repeats, saved)
            size = sum(map(len, timed.result))
            record = {
                "codec": self.codec,
                "rate": rate,
                "codec_version": codec.version,
                "bytes": size,
                "bpp": 8 * size / points,
                "repeats": self.repeats,
                **timed.costs("encode"),
            }
            coded[rate] = CodedDrive(tuple(timed.result), record)
            progress(done, len(rates))
        write_coded_drive(curve, coded)
        return {"rates": len(coded)}


def _saved(shared: Sequence[Any]) -> Callable[[Cost], Cost]:
    def whole(here: Cost) -> Cost:
        for work in filter(None, shared):
            here = here.plus(work.saved)
        return here

    return whole
