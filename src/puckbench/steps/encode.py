from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cloud_files.clouds import IN_METRES, read_cloud
from cloud_files.content import plain_suffix
from pointkit.errors import InputError, naming, noting
from pointkit.geometry.cloud import CoordinateFrame, PointCloud
from pointkit.lidar.returns import with_returns
from pointkit.measurement import Cost, measured
from pointkit.terminal import Progress
from puckbench.codecs.base import CloudKind, Codec, SharedWork
from puckbench.codecs.budget import rate_within
from puckbench.codecs.coding import attribute_bytes, check_codes, cost_of, encoded
from puckbench.codecs.rates import Budget, budget_of, budgets_of, rates_of
from puckbench.codecs.weights_label import weights_label
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.core.environment import cpu_model, run_environment
from puckbench.geometry.attributes import RETURNS, not_coded
from puckbench.results.curves import (
    NOT_CODED,
    REMARK,
    USED_RATE,
    Coded,
    with_remarks,
    write_curve,
)
from puckbench.steps.coding import (
    TimedStep,
    TimingSettings,
    is_checked_twice,
    planned_codec_step,
    ready,
)
from puckbench.steps.step import STEPS, PlannedStep

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*CLOUD_FILES, *CODEC, "puckbench.codecs.budget")


@STEPS.register("encode")
class Encode(TimedStep):
    """Encode a cloud at all rates of a codec for the cloud's coordinate frame."""

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str, codec: str) -> PlannedStep:
        rates = flow.plan.curve_rates(dataset, cloud, codec)
        entry = flow.plan.coding_entry(dataset, codec, rates)
        step = cls(codec=codec, entry=entry, **flow.plan.timing)
        return planned_codec_step(flow, step, flow.files.cloud(dataset, cloud))

    def run(self, cloud: Path, curve: Path) -> dict[str, Any]:
        """Encode the file `cloud`, write all streams to `curve`, and return the number of rates."""
        codec = self.opened()
        original = to_code(codec, cloud)
        rates = tuple(rates_of(codec, original.frame or "scaled"))
        ready(codec)
        twice = is_checked_twice(codec, self.repeats)
        progress, coded, shared = Progress("rate"), {}, codec.prepare(original)
        for done, rate in enumerate(rates, start=1):
            first = twice and done == 1
            coded[rate] = coded_cloud(codec, original, rate, self, shared, again=first)
            progress(done, len(rates))
        write_curve(curve, coded)
        return {"rates": len(coded)}


def coded_cloud(
    codec: Codec,
    cloud: PointCloud,
    rate: str,
    timing: TimingSettings,
    shared: SharedWork | None = None,
    again: bool = False,
) -> Coded:
    """Encode a cloud at one rate, and return the stream with facts about the encoding.

    Parameters
    ----------
    codec, cloud, rate
        The codec, ready to code, the cloud to encode, and the name of the rate. If it is one of the
        codec's budgets, the record also names the rate that meets it.
    timing
        How the encoding is timed.
    shared
        Results of the encoding at other rates that are reused (`Codec.prepare`). Their cost is
        added, as if they were computed again.
    again
        Whether to encode once more. If the streams differ, the record gets a remark.
    """

    if rate in budgets_of(codec) and (budget := budget_of(codec, rate)):
        with noting(f"rate {rate}"):
            met = coded_within(codec, cloud, budget, timing, shared, again=again)
        used = {"rate": rate, USED_RATE: met.record["rate"]}
        return met._replace(record={**met.record, **used})

    def whole(here: Cost) -> Cost:
        cost = cost_of(codec, here)
        return cost if shared is None else cost.plus(shared.saved)

    streams: set[bytes] = set()
    with noting(f"rate {rate}"):
        timed = measured(
            lambda: encoded(codec, cloud, rate, shared), timing.repeats, whole, streams.add
        )
        if again:
            streams.add(encoded(codec, cloud, rate))
    weights = weights_label(codec.weights(rate))
    record = {
        "codec": codec.name,
        "rate": rate,
        "codec_version": codec.version,
        **({"weights": weights} if weights else {}),
        "points_in": len(cloud),
        "bytes": len(timed.result),
        "bpp": 8 * len(timed.result) / len(cloud),
        "repeats": timing.repeats,
        **_attribute_columns(codec, cloud, timed.result),
        **timed.costs("encode"),
        **run_environment(timing.exclusive),
        "encode_cpu": cpu_model(),  # decoding may run on another machine
        **({REMARK: "repeated encodings differ"} if len(streams) > 1 else {}),
    }
    return Coded(timed.result, record)


def coded_within(
    codec: Codec,
    cloud: PointCloud,
    budget: Budget,
    timing: TimingSettings,
    shared: SharedWork | None = None,
    seconds: float | None = None,
    again: bool = False,
) -> Coded:
    """Encode a cloud at the rate that meets a budget of bits (`puckbench.codecs.budget`).

    Parameters
    ----------
    codec, cloud, shared, again
        As for `coded_cloud`.
    budget
        The most bits that the stream may take.
    timing
        How the encoding at the rate that was found is timed. The search is not timed.
    seconds
        Time in which the sensor recorded the cloud, s, for budgets in megabits per second.

    Returns
    -------
    Coded
        The stream with facts about its encoding. Its remark tells if it leaves much of the budget.

    Raises
    ------
    InputError
        The budget is less than the codec's coarsest rate takes.
    """
    once = timing.model_copy(update={"repeats": 1})
    tried: dict[str, Coded] = {}

    def encode(rated: Codec, rate: str) -> int:
        tried[rate] = coded_cloud(rated, cloud, rate, once, shared)
        return len(tried[rate].stream)

    chosen = rate_within(codec, [cloud], budget, encode, seconds)
    coded = tried[chosen.rate]
    if timing.repeats > 1 or again:
        coded = coded_cloud(chosen.codec, cloud, chosen.rate, timing, shared, again)
    return coded._replace(record=with_remarks(coded.record, chosen.remark))


def to_code(
    codec: Codec, path: Path, frame: CoordinateFrame | None = None, rate: str | None = None
) -> PointCloud:
    """Return the cloud in a file, ready for a codec to encode.

    The sensor's returns beside the file are read too if the codec encodes returns or attributes.

    Parameters
    ----------
    codec
        The codec that will encode the cloud.
    path
        File of the cloud.
    frame
        Coordinate frame of the cloud; by default metric for file formats that are in metres, and
        otherwise the frame in the description beside the file.
    rate
        Name of the rate, which must be one for this coordinate frame; by default, any rate.

    Raises
    ------
    InputError
        The description names another frame, or the codec has no rate for clouds in this frame.
    """
    cloud = read_cloud(path)
    if frame is None and plain_suffix(path) in IN_METRES:
        frame = "metric"
    with naming(path):
        if frame and cloud.frame and frame != cloud.frame:
            raise InputError(f"its description says that it is {cloud.frame}, not {frame}")
        cloud = _in_frame(cloud, frame)
        cloud = with_returns(cloud, path) if codec.attributes else cloud
        check_codes(codec, CloudKind.of(cloud), rate)
        return cloud


def _in_frame(cloud: PointCloud, frame: CoordinateFrame | None) -> PointCloud:
    if frame in (None, cloud.frame):
        return cloud
    size = 0 if frame == "metric" else max(2, int(cloud.xyz.max()) + 1)
    return replace(cloud, about={**cloud.about, "size": size})


def _attribute_columns(codec: Codec, cloud: PointCloud, stream: bytes) -> dict[str, Any]:
    columns: dict[str, Any] = {}
    if sizes := attribute_bytes(codec, stream) if {*codec.attributes} - {RETURNS} else {}:
        parts = {"geometry": len(stream) - sum(sizes.values()), **sizes}
        columns = {f"bpp_{name}": 8 * size / len(cloud) for name, size in parts.items()}
    left = not_coded(cloud, sizes or codec.attributes)
    return {**columns, **({NOT_CODED: ", ".join(left)} if left else {})}
