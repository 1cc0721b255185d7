"""What steps share that run a codec."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pydantic import Field

from pointkit.errors import InputError, noting
from pointkit.geometry.cloud import PointCloud, check_points
from pointkit.measurement import measured
from pointkit.models import Model
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import cost_of, decoded, why_not_here
from puckbench.codecs.registry import module_of, open_codec
from puckbench.core.environment import run_environment
from puckbench.results.curves import REMARK, Coded
from puckbench.steps.step import Inputs, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = ("puckbench.codecs.base", "puckbench.results.curves")


class CodecStep(Step):
    """Base class of steps that use a codec.

    Parameters
    ----------
    codec
        Name of the codec.
    entry
        The codec's entry in the configuration: changes to its options and rates.
    """

    codec: str
    entry: dict[str, Any] = Field({})

    def plugins(self) -> Iterable[str | None]:
        return codec_plugins(self.codec, self.entry)

    def opened(self) -> Codec:
        """Return the codec, which may not be ready to code."""
        return open_codec(self.codec, self.entry)


class TimingSettings(Model):
    """How times of encoding and decoding are measured."""

    repeats: int = Field(
        3,
        ge=1,
        description="Number of times each encoding and decoding is run; the median time is "
        "reported.",
    )
    exclusive: bool = Field(False, description="Run no other job beside a job with timed calls.")


class TimedStep(CodecStep, TimingSettings):
    """Base class of steps that measure the time of encoding or decoding."""


def ready(codec: Codec) -> Codec:
    """Return a codec after it has loaded its weights and compiled its loops.

    Raises InputError if the codec cannot run on this machine.
    """
    if why := why_not_here(codec):
        raise InputError(f"codec {codec.name} cannot run here: {why}")
    codec.load()
    return codec


def codec_plugins(name: str | None, entry: Mapping[str, Any]) -> Iterable[str | None]:
    """Return the names or places of the plug-ins of a codec with this entry."""
    return name, entry.get("class"), entry.get("training")


def with_options(entry: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return a codec's entry of the configuration with some options added or replaced."""
    return {**entry, "options": {**entry.get("options", {}), **more}}


def is_checked_twice(codec: Codec, repeats: int) -> bool:
    """Return whether to call a codec once more, to check that results are the same.

    This is done for the user's codecs only, and only if timing does not repeat calls anyway.
    """
    return repeats == 1 and not type(codec).__module__.startswith("puckbench.")


class Decoded(NamedTuple):
    """A decoded cloud, and facts about its encoding and decoding by column of results."""

    cloud: PointCloud
    record: dict[str, Any]


def decoded_cloud(
    codec: Codec, coded: Coded, timing: TimingSettings, *, twice: bool = False
) -> Decoded:
    """Decode a stream, and measure the time and memory of the decoding.

    Parameters
    ----------
    codec
        The codec, ready to code.
    coded
        The stream and its record.
    timing
        How the decoding is timed.
    twice
        Whether to decode once more if the codec is the user's own. If the points differ, the
        record gets a remark.
    """
    with noting(f"rate {coded.record.get('rate', '?')}"):
        timed = measured(
            lambda: decoded(codec, coded.stream), timing.repeats, partial(cost_of, codec)
        )
        check_points(timed.result.xyz, f"codec {codec.name}: decoded points")
        twice = twice and is_checked_twice(codec, timing.repeats)
        differ = twice and not np.array_equal(decoded(codec, coded.stream).xyz, timed.result.xyz)
    remarks = [coded.record.get(REMARK), "repeated decodings differ" if differ else None]
    record = {
        **coded.record,
        **({REMARK: "; ".join(filter(None, remarks))} if any(remarks) else {}),
        "codec": codec.name,
        "bytes": len(coded.stream),
        "points_out": len(timed.result),
        **timed.costs("decode"),
        **run_environment(timing.exclusive),
    }
    return Decoded(timed.result, record)


def planned_codec_step(
    flow: Workflow,
    step: CodecStep,
    inputs: Inputs,
    *code: str,
    also: object = "",
    memory_mb: int | None = None,
    minutes: int | None = None,
) -> PlannedStep:
    """Return a planned step that runs again if the code or the weights of its codec change.

    Parameters
    ----------
    flow
        The planned run.
    step, inputs, code, also
        As for `planned`.
    memory_mb, minutes
        Memory and time to request; by default those for coding the largest cloud of the run at all
        rates.
    """
    plan, codec = flow.plan, step.codec
    module, weights = module_of(plan.codecs[codec]["class"]), plan.weights_digest(codec)
    threads = plan.config.timing.threads if isinstance(step, TimedStep) else ""
    return planned(
        step,
        inputs,
        module,
        *code,
        also=f"{weights} {also} {threads}",
        memory_mb=flow.costs.memory_mb(codec) if memory_mb is None else memory_mb,
        minutes=flow.costs.minutes(codec) if minutes is None else minutes,
    )
