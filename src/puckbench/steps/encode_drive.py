from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import noting
from pointkit.geometry.cloud import PointCloud
from pointkit.measurement import Cost, measured
from pointkit.terminal import Progress
from puckbench.codecs.base import Codec
from puckbench.codecs.budget import rate_within
from puckbench.codecs.coding import encoded
from puckbench.codecs.rates import Budget, budget_of, rates_of
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.recordings.drives import read_drive
from puckbench.results.coded_drives import CodedDrive, write_coded_drive
from puckbench.results.curves import USED_RATE, with_remarks
from puckbench.steps.coding import TimedStep, planned_codec_step, ready
from puckbench.steps.step import STEPS, PlannedStep

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *(*CLOUD_FILES, *CODEC, "cloud_files.poses", "puckbench.recordings"),
    *("puckbench.codecs.budget", "puckbench.results.coded_drives"),
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
        codec, original = ready(self.opened()), read_drive(drive)
        turns = without_times(original.turns)
        rates, shared = rates_of(codec, "metric"), [codec.prepare(turn) for turn in turns]
        progress, coded = Progress("rate"), {}
        for done, rate in enumerate(rates, start=1):
            if budget := budget_of(codec, rate):
                seconds = original.seconds
                with noting(f"rate {rate}"):
                    met = turns_within(codec, turns, budget, seconds, self.repeats, shared)
                used = {"rate": rate, USED_RATE: met.record["rate"]}
                coded[rate] = replace(met, record={**met.record, **used})
            else:
                coded[rate] = coded_turns(codec, turns, rate, self.repeats, shared)
            progress(done, len(rates))
        write_coded_drive(curve, coded)
        return {"rates": len(coded)}


def without_times(turns: Sequence[PointCloud]) -> list[PointCloud]:
    """Return the turns of a drive as codecs get them: without the times of points."""
    return [replace(turn, fields={}) for turn in turns]


def coded_turns(
    codec: Codec,
    turns: Sequence[PointCloud],
    rate: str,
    repeats: int,
    shared: Sequence[Any],
) -> CodedDrive:
    """Encode each turn of a drive at one rate.

    Parameters
    ----------
    codec, turns, rate
        The codec, ready to code, the turns, and the name of the rate.
    repeats
        Number of timed encodings of all turns.
    shared
        Results that all rates share (`Codec.prepare`), one for each turn.
    """

    def encoded_turns() -> list[bytes]:
        each = zip(turns, shared, strict=True)
        return [encoded(codec, turn, rate, work) for turn, work in each]

    with noting(f"rate {rate}"):
        timed = measured(encoded_turns, repeats, _saved(shared))
    size = sum(map(len, timed.result))
    record = {
        "codec": codec.name,
        "rate": rate,
        "codec_version": codec.version,
        "bytes": size,
        "bpp": 8 * size / sum(map(len, turns)),
        "repeats": repeats,
        **timed.costs("encode"),
    }
    return CodedDrive(tuple(timed.result), record)


def turns_within(
    codec: Codec,
    turns: Sequence[PointCloud],
    budget: Budget,
    seconds: float,
    repeats: int,
    shared: Sequence[Any],
) -> CodedDrive:
    """Encode each turn of a drive at the one rate at which all together meet a budget of bits.

    `seconds` is the duration of the turns, s. Other arguments are those of `coded_turns`. Raises
    InputError if the budget is less than the codec's coarsest rate takes.
    """
    tried: dict[str, CodedDrive] = {}

    def encode(rated: Codec, rate: str) -> int:
        tried[rate] = coded_turns(rated, turns, rate, 1, shared)
        return sum(map(len, tried[rate].streams))

    chosen = rate_within(codec, turns, budget, encode, seconds)
    coded = tried[chosen.rate]
    if repeats > 1:
        coded = coded_turns(chosen.codec, turns, chosen.rate, repeats, shared)
    return replace(coded, record=with_remarks(coded.record, chosen.remark))


def _saved(shared: Sequence[Any]) -> Callable[[Cost], Cost]:
    def whole(here: Cost) -> Cost:
        for work in filter(None, shared):
            here = here.plus(work.saved)
        return here

    return whole
