from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from pointkit.errors import InputError, naming
from pointkit.files import write_json, written_whole
from pointkit.geometry.cloud import CoordinateFrame, PointCloud
from puckbench.cli.codec_options import codec_arguments, opened_codec, timing_of
from puckbench.cli.types import note, positive, refuse
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import check_codes
from puckbench.codecs.rates import Budget, is_length, rate_name, scaled_rates
from puckbench.core.archives import SUFFIX
from puckbench.geometry.attributes import RETURNS
from puckbench.results.curves import REMARK, record_file
from puckbench.steps.coding import TimingSettings, ready
from puckbench.steps.encode import coded_cloud, coded_within, to_code


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    text = (
        "cloud to code (PLY, PCD, LAS, ...); or, for codecs of returns, a recording of packets; or "
        "a drive (results/drives/NAME/DRIVE.zip)"
    )
    add("cloud", type=Path, help=text)
    text = (
        "stream to write, with its record (JSON) beside it; of a drive, a ZIP file with a stream "
        "for each turn"
    )
    add("out", type=Path, help=text)
    rate = parser.add_mutually_exclusive_group(required=True)
    text = "r1 (smallest bitrate), r2, ...; for clouds in metres any length such as 3mm"
    rate.add_argument("--rate", help=text)
    text = (
        "instead of a rate: the most bits per point; the step that takes nearly all of them is "
        "found, or the largest of fixed rates"
    )
    rate.add_argument("--bpp", type=positive, metavar="BITS", help=text)
    text = "as --bpp: the most megabits per second of a recording's or drive's duration"
    rate.add_argument("--mbps", type=positive, metavar="MEGABITS", help=text)
    text = "G-PCC: write a bare stream, as the reference software does"
    add("--raw", action="store_true", help=text)
    text = (
        "coordinate frame of a cloud without a description (.json) beside it (default: metric for "
        "LAS, LAZ, E57 and .bin)"
    )
    add("--frame", choices=["scaled", "metric"], help=text)
    text = (
        "first prepare the cloud and write it to this file: in metres if the rate is a length, "
        "else scaled (or as --frame says)"
    )
    add("--prepare", type=Path, metavar="PLY", help=text)
    codec_arguments(parser, required=True)


def run(options: argparse.Namespace) -> dict[str, Any]:
    timing = timing_of(options)
    codec = opened_codec(options, **({"raw": True} if options.raw else {}))
    rate, budget = None, _budget(options)
    if budget is None:
        with naming("--rate"):
            rate = rate_name(codec, options.rate)
    if options.cloud.suffix.lower() == SUFFIX:
        return _coded_drive(options, codec, rate, budget, timing)
    original, seconds = _original(options, codec, rate)
    if RETURNS in codec.attributes and original.returns is None:
        why = f"no returns, so codec {codec.name} does without its sensor"
        note(f"{options.prepare or options.cloud}: {why}")
    ready(codec)
    if budget:
        with naming(f"--{budget.unit}"):
            coded = coded_within(codec, original, budget, timing, seconds=seconds)
        coded = coded._replace(record={**coded.record, **_met(budget, coded.record, seconds)})
    else:
        coded = coded_cloud(codec, original, str(rate), timing)
    with written_whole(options.out) as temporary:
        temporary.write_bytes(coded.stream)
        write_json(record_file(options.out), coded.record)
    return coded.record


def _budget(options: argparse.Namespace) -> Budget | None:
    if options.bpp is not None:
        return Budget(options.bpp, "bpp")
    return None if options.mbps is None else Budget(options.mbps, "mbps")


def _met(budget: Budget, record: dict[str, Any], seconds: float | None) -> dict[str, Any]:
    """Return what a record says of a budget, and tell on standard error what it leaves unused."""
    if REMARK in record:
        note(record[REMARK])
    mbps = {} if seconds is None else {"mbps": 8e-6 * record["bytes"] / seconds}
    return {"budget": budget.name, **mbps}


class _Original(NamedTuple):
    """What is coded, and the time in which the sensor recorded it, s, if it is known."""

    cloud: PointCloud
    seconds: float | None


def _original(options: argparse.Namespace, codec: Codec, rate: str | None) -> _Original:
    from puckbench.scene_sets.recordings import RECORDING_SUFFIXES, is_bag_folder

    source = options.cloud
    if source.suffix.lower() in RECORDING_SUFFIXES or is_bag_folder(source):
        refuse(options, {"prepare": None, "frame": None}, "is not for recordings")
        return _recorded(source, codec, rate)
    if options.prepare:
        has_scaled = bool(scaled_rates(codec.rates)) if rate is None else not is_length(codec, rate)
        of_rate: CoordinateFrame = "scaled" if has_scaled else "metric"
        frame = options.frame or of_rate
        check_codes(codec, CloudKind(frame, True, True), rate)
        _prepare(options.cloud, options.prepare, in_metres=frame == "metric")
    cloud = to_code(codec, options.prepare or options.cloud, options.frame, rate)
    seconds = cloud.about.get("seconds")
    return _Original(cloud, float(seconds) if isinstance(seconds, int | float) else None)


def _recorded(path: Path, codec: Codec, rate: str | None) -> _Original:
    """Return the complete turns of a recording as one cloud with the returns of all turns."""
    from puckbench.codecs.returns_codec import ReturnsCodec
    from puckbench.recordings.reading import read_turns
    from puckbench.scene_sets.recordings import decompressed

    if not isinstance(codec, ReturnsCodec):
        raise InputError(
            f"{path}: codec {codec.name} codes single clouds, not the turns of a recording: take a "
            "codec of returns such as puck, or export the turns (puckbench export)"
        )
    with decompressed(path) as readable:
        recorded = read_turns(readable, source=path)
    turns = recorded.returns.turns[recorded.whole.start : recorded.whole.stop]
    if not turns:
        raise InputError(f"{path}: no whole turn in the recording")
    returns = replace(recorded.returns, turns=turns)
    cloud = PointCloud(returns.points(), returns=returns, about={"size": 0, "source": path.name})
    with naming(path):
        check_codes(codec, CloudKind.of(cloud), rate)
    return _Original(cloud, recorded.seconds)


def _coded_drive(
    options: argparse.Namespace,
    codec: Codec,
    rate: str | None,
    budget: Budget | None,
    timing: TimingSettings,
) -> dict[str, Any]:
    """Code each turn of a drive at one rate, as a run does, and write all streams to one file."""
    from puckbench.recordings.drives import read_drive
    from puckbench.results.coded_drives import write_coded_drive
    from puckbench.steps.encode_drive import coded_turns, turns_within, without_times

    refuse(options, {"prepare": None, "frame": None}, "is not for drives")
    drive = read_drive(options.cloud)
    turns = without_times(drive.turns)
    with naming(options.cloud):
        kind = CloudKind.of(turns[0])._replace(frame="metric")
        check_codes(codec, kind, rate)
    works = [ready(codec).prepare(turn) for turn in turns]
    if budget:
        with naming(f"--{budget.unit}"):
            coded = turns_within(codec, turns, budget, drive.seconds, timing.repeats, works)
        met = _met(budget, dict(coded.record), drive.seconds)
        coded = replace(coded, record={**coded.record, **met})
    else:
        coded = coded_turns(codec, turns, str(rate), timing.repeats, works)
    write_coded_drive(options.out, {str(coded.record["rate"]): coded})
    return dict(coded.record)


def _prepare(source: Path, cloud: Path, in_metres: bool) -> None:
    from puckbench.steps.prepare import Prepare, measured_points

    step = Prepare(size="metric") if in_metres else Prepare()
    step.write(source, measured_points(source), {}, cloud)
