"""Streams whose header and syntax fields are at their limits, with check sums that fit.

They come from the codecs' own writers, whose refusals are switched off: what no encoder makes, an
attacker may. The same number makes the same stream.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from io import BytesIO
from itertools import count
from typing import Any
from unittest.mock import patch

import numpy as np

from gpcc import syntax
from pcc_networks.sparse.voxels import morton_voxels
from pointkit.coding.byte_io import Reader, base_128, signed_128
from pointkit.coding.framing import Framing
from pointkit.coding.zstandard import compressed
from pointkit.errors import InputError
from pointkit.seeding import generator
from puck.records import Record, RecordKind, read_records, start
from tests.support.stream_damage import limit

Random = np.random.Generator


def structured(codec: str, streams: Sequence[bytes], number: int) -> bytes:
    """One structured stream of a codec, of which `streams` are whole ones."""
    for attempt in count():
        with suppress(ValueError, struct.error, InputError):  # what no field has room for
            return WRITERS[codec](streams, generator(number, f"structured streams {attempt}"))
    raise AssertionError


def data(random: Random) -> bytes:
    """Coded bits: none, all zeros or ones (one decision for ever), a pattern, noise."""
    size = limit(random, 12)
    patterns = (b"", b"\0", b"\xff", b"\x11", b"\0\0\0\xa0", b"\x80\0")
    pattern = patterns[random.integers(len(patterns))] * size
    noise = random.integers(0, 256, int(random.integers(200)), dtype=np.uint8).tobytes()
    return (pattern, noise, pattern[: int(random.integers(1, 40))] + noise)[random.integers(3)]


def packed_voxels(random: Random) -> bytes:
    """Voxels as `gpcc.lossless` packs them, of any size and number."""
    sides = sum(min(limit(random, 5), 31) << 5 * axis for axis in range(3))
    low = [limit(random, 31) * int(random.choice([-1, 1])) for _ in range(3)]
    numbers = [*map(signed_128, low), base_128(limit(random, 25)), base_128(sides)]
    return b"".join(numbers) + data(random)


def primitives(streams: Sequence[bytes], random: Random) -> bytes:
    """A surface, voxels, or a hybrid of two streams, each of which may be any of the three."""
    from primitive_codec.stream import CLASSES, HybridHeader, pack_hybrid

    if random.random() < 0.8:
        return _surface_or_voxels(random)
    surface, voxels = (_surface_or_voxels(random) for _ in range(2))
    if random.random() < 0.5:
        surface = streams[random.integers(len(streams))]
    factors = random.integers(-128, 128, CLASSES).astype(np.int8)
    hybrid = pack_hybrid(HybridHeader(limit(random, 8), factors, surface, voxels))
    return (
        hybrid if random.random() < 0.9 else pack_hybrid(HybridHeader(8, factors, hybrid, hybrid))
    )


def _surface_or_voxels(random: Random) -> bytes:
    """A header of surfaces or voxels, changed in a few fields or in all."""
    from primitive_codec.stream import (
        CLASSES,
        MAX_CELLS,
        DisplacementTable,
        SurfaceHeader,
        VoxelGrid,
        pack_surface,
        pack_voxels,
    )

    place = VoxelGrid(random.normal(size=3), float(10.0 ** random.integers(-30, 30)))
    if random.random() < 0.1:
        factors = random.integers(-128, 128, CLASSES).astype(np.int8)
        table = DisplacementTable(int(random.choice([1, 2, 4, 3])), factors)
        return pack_voxels(place, table if random.random() < 0.7 else None, packed_voxels(random))
    depth = int(random.integers(18))
    finest = int(random.integers(depth + 1)) if random.random() < 0.9 else limit(random, 5)
    coarsest = max(depth - int(random.integers(10)), 0) if random.random() < 0.8 else finest
    x, y = (1 << min(depth, int(random.integers(17))) for _ in range(2))
    z = max(min(MAX_CELLS // (x * y), 1 << depth), 1)  # the product at its bound
    sides = [max(1, min(65535, side + int(random.integers(-1, 2)))) for side in (x, y, z)]
    random.shuffle(sides)
    capacity = limit(random, 23) if random.random() < 0.5 else 1 << 20
    spacing = int(random.choice([0, 127, 128, 1000, 2048, 65535]))
    revolutions = _revolution(random) * int(random.choice([0, 0, 1, 2, 255]))
    header = SurfaceHeader(
        place.origin, place.cell_size, (sides[0], sides[1], sides[2]),
        depth, finest, min(coarsest, 255), max(limit(random, 8), 1), spacing, capacity,
        (0, 0, 0) if random.random() < 0.5 else (limit(random, 15), 1, -1), revolutions,
    )  # fmt: skip
    return pack_surface(header, data(random))


def _revolution(random: Random) -> bytes:
    from primitive_codec.revolution import _PARAMETERS

    signed = [limit(random, 15) * int(random.choice([-1, 1])) for _ in range(7)]
    kind, rows = int(random.integers(7)), limit(random, 16)
    return _PARAMETERS.pack(kind, *signed[:5], limit(random, 16), *signed[5:], rows)


def gpcc(streams: Sequence[bytes], random: Random) -> bytes:
    """Parameter sets and slices of other fields than an encoder's, or more of them."""
    sps, gps = syntax.SequenceParameterSet(seq_origin_bits=1), syntax.GeometryParameterSet()
    change(gps, random, 0.3)
    gps.gps_geom_parameter_set_id = gps.gps_seq_parameter_set_id = gps.geom_tree_type = 0
    gps.geom_angular_mode_enabled_flag = gps.geom_scaling_enabled_flag = (
        gps.trisoup_enabled_flag
    ) = 0
    gps.bitwise_occupancy_coding_flag = 1
    if random.random() < 0.3:
        change(sps, random, 0.2)
        sps.sps_seq_parameter_set_id = sps.num_attributes = 0
        sps.seq_origin_bits, sps.seq_bbox_size_bits = 1, 0
        sps.seq_global_scale_refinement_num_bits %= 64
        sps.seq_global_scale_refinement_factor = 0
    depth = max(min(limit(random, 6), 63), 1)
    axes = [int(random.choice([7, 7, 4, 2, 1, 0])) for _ in range(depth)]
    header = syntax.GeometryHeader(
        slice_geom_origin_bits_minus1=40, slice_geom_origin_xyz=(limit(random, 33), 0, 1),
        tree_depth_minus1=depth - 1, tree_lvl_coded_axis_list=axes,
        geom_stream_cnt_minus1=int(random.choice([0, 0, 0, 1, depth - 1, depth, 255])),
    )  # fmt: skip
    footer = syntax.footer_of(1 + limit(random, 24))
    unit = syntax.written(syntax.geometry_header, header, sps, gps) + data(random)
    unit += footer
    parts = [
        syntax.encapsulate(0, syntax.written(syntax.sequence_parameter_set, sps)),
        syntax.encapsulate(1, syntax.written(syntax.geometry_parameter_set, gps)),
    ]
    return b"".join(parts) + syntax.encapsulate(2, unit) * int(random.choice([1, 1, 2, 1000]))


def gpcc_angular(streams: Sequence[bytes], random: Random) -> bytes:
    """Octrees with the fields of sensors at their limits."""
    signs = [int(random.choice([-1, 1])) for _ in range(3)]
    wide, each_slice = random.random() < 0.3, int(random.integers(2))
    count = min(max(limit(random, 11), 1), syntax.MAX_LASERS) if random.random() < 0.3 else 16
    theta = [limit(random, 29 if wide else 19) * int(random.choice([-1, 1])) for _ in range(count)]
    turns = max(limit(random, 29 if wide else 12), 1) if random.random() < 0.9 else 0
    far = 31 if random.random() < 0.1 else 22
    origin = {"bits_minus1": 30, "xyz": tuple(sign * limit(random, far) for sign in signs)}
    gps = syntax.GeometryParameterSet(
        geom_unique_points_flag=int(random.integers(2)), qtbt_enabled_flag=1,
        inferred_direct_coding_mode=int(random.choice([0, 1, 2, 3, 3, 3])),
        joint_2pt_idcm_enabled_flag=int(random.integers(2)),
        neighbour_avail_boundary_log2_minus1=int(random.choice([0, 1, 7])),
        adjacent_child_contextualization_enabled_flag=int(random.integers(2)),
        geom_planar_mode_enabled_flag=int(random.random() < 0.8),
        planar_buffer_disabled_flag=int(random.integers(2)), bitwise_occupancy_coding_flag=1,
        geom_angular_mode_enabled_flag=1, geom_slice_angular_origin_present_flag=each_slice,
        lasers=[
            syntax.Laser(tan, signs[k % 3] * limit(random, 29), turns)
            for k, tan in enumerate(theta)
        ],
        **{f"gps_angular_origin_{key}": value for key, value in origin.items()},
    )  # fmt: skip
    levels = max(min(limit(random, 6), 63), 1)
    axes = [int(random.choice([7, 7, 7, 6, 6, 4, 2, 1])) for _ in range(levels)]
    header = syntax.GeometryHeader(
        slice_geom_origin_bits_minus1=40, slice_geom_origin_xyz=(limit(random, far), 0, 1),
        tree_depth_minus1=levels - 1, tree_lvl_coded_axis_list=axes,
        geom_stream_cnt_minus1=int(random.choice([0, 0, 0, 1, levels - 1])),
        **{f"gdu_angular_origin_{key}": value for key, value in origin.items()},
    )  # fmt: skip
    sps = syntax.SequenceParameterSet(
        seq_origin_bits=1, geom_axis_order=int(random.integers(8)),
        bypass_stream_enabled_flag=int(random.random() < 0.1),
    )  # fmt: skip
    footer = syntax.footer_of(1 + limit(random, 24))
    unit = syntax.written(syntax.geometry_header, header, sps, gps) + data(random)
    unit += footer
    parts = [
        syntax.encapsulate(0, syntax.written(syntax.sequence_parameter_set, sps)),
        syntax.encapsulate(1, syntax.written(syntax.geometry_parameter_set, gps)),
    ]
    return b"".join(parts) + syntax.encapsulate(2, unit) * int(random.choice([1, 1, 2, 1000]))


def gpcc_predictive(streams: Sequence[bytes], random: Random) -> bytes:
    """Prediction trees with the fields of sensors, QPs and residuals at their limits."""
    signs = [int(random.choice([-1, 1])) for _ in range(3)]
    angular, scaled = int(random.random() < 0.7), int(random.random() < 0.5)
    each_slice, wide = int(random.integers(2)), random.random() < 0.2
    count = min(max(limit(random, 11), 1), syntax.MAX_LASERS) if random.random() < 0.3 else 16
    theta = [limit(random, 29 if wide else 19) * int(random.choice([-1, 1])) for _ in range(count)]
    origin = {"bits_minus1": 30, "xyz": tuple(sign * limit(random, 31) for sign in signs)}
    gps = syntax.GeometryParameterSet(
        geom_unique_points_flag=int(random.integers(2)), geom_tree_type=syntax.PREDICTIVE,
        geom_angular_mode_enabled_flag=angular, geom_slice_angular_origin_present_flag=each_slice,
        geom_angular_azimuth_scale_log2_minus11=min(limit(random, 5), 19),
        geom_angular_azimuth_speed_minus1=limit(random, 32),
        geom_angular_radius_inv_scale_log2=min(limit(random, 5), 31),
        lasers=[syntax.Laser(tan, signs[k % 3] * limit(random, 29)) for k, tan in enumerate(theta)],
        geom_scaling_enabled_flag=scaled, geom_base_qp=limit(random, 8),
        geom_qp_multiplier_log2=limit(random, 2), geom_qp_offset_intvl_log2=limit(random, 6),
        gps_extension_flag=1, azimuth_scaling_enabled_flag=int(random.integers(2)),
        **{f"gps_angular_origin_{key}": value for key, value in origin.items()},
    )  # fmt: skip
    widths = [int(random.choice([0, 3, 4, 5, 5, 6, 7])) for _ in range(3)]
    header = syntax.GeometryHeader(
        slice_geom_origin_bits_minus1=40, slice_geom_origin_xyz=(limit(random, 31), 0, 1),
        geom_slice_qp_offset=signs[0] * limit(random, 8) * int(random.random() < 0.3),
        geom_qp_offset_intvl_log2_delta=limit(random, 32) * int(random.random() < 0.3),
        pgeom_resid_abs_log2_bits=(widths[0], widths[1], widths[2]),
        pgeom_min_radius=limit(random, 32),
        **{f"gdu_angular_origin_{key}": value for key, value in origin.items()},
    )  # fmt: skip
    sps = syntax.SequenceParameterSet(
        seq_origin_bits=1, geom_axis_order=int(random.integers(8)),
        bypass_stream_enabled_flag=int(random.random() < 0.1),
    )  # fmt: skip
    coded = data(random)
    if random.random() < 0.6:  # what decodes to trees
        coded = streams[random.integers(len(streams))][150 : limit(random, 12) + 150]
    footer = syntax.footer_of(1 + limit(random, 24))
    unit = syntax.written(syntax.geometry_header, header, sps, gps) + coded
    parts = [
        syntax.encapsulate(0, syntax.written(syntax.sequence_parameter_set, sps)),
        syntax.encapsulate(1, syntax.written(syntax.geometry_parameter_set, gps)),
        syntax.encapsulate(2, unit + footer) * int(random.choice([1, 1, 1, 1000])),
    ]
    return b"".join(parts)


def change(record: Any, random: Random, share: float) -> None:
    """Give some of a record's numbers, flags as a rule, other values."""
    for field in fields(record):
        if field.default in (0, 1) and random.random() < share:
            flag = field.name.endswith(("flag", "present"))
            small = field.name.endswith(("_bits", "mode", "order", "minus1"))
            setattr(record, field.name, limit(random, 1 if flag else 2 if small else 5))


def _learned(
    module: str, change: Callable[[Any, Random], Any], write: str, checks: Sequence[str]
) -> Callable[[Sequence[bytes], Random], bytes]:
    """A writer that changes fields of a whole stream as it was parsed."""

    def written(streams: Sequence[bytes], random: Random) -> bytes:
        from importlib import import_module

        stream = import_module(module)
        whole = [each for each in streams if each.startswith(stream.MAGIC)]  # not shifted ones
        coded = stream.read_stream(whole[random.integers(len(whole))])
        if not hasattr(coded, "digest"):  # few points, uncompressed
            return streams[0]
        patches = [patch.object(stream, name, lambda *_: 2**62) for name in checks]
        for each in patches:
            each.start()
        try:
            return getattr(stream, write)(change(coded, random))  # type: ignore[no-any-return]
        finally:
            for each in patches:
                each.stop()

    return written


def _changed1(coded: Any, random: Random) -> Any:
    some = {
        "cubes": limit(random, 16), "points_per_voxel": limit(random, 16),
        "positions": packed_voxels(random), "sparse": packed_voxels(random),
        "counts": data(random), "latent": data(random), "rate": limit(random, 3),
        "context_mixing": bool(random.integers(2)), "scale": 2.0 ** int(random.integers(-400, 16)),
        "batches": coded.batches * min(limit(random, 12), 64),
    }  # fmt: skip
    return replace(coded, **_some(some, random))


def _changed2(coded: Any, random: Random) -> Any:
    block = coded.blocks[0]
    counts = [limit(random, 22) for _ in range(4)] if random.random() < 0.5 else [
        min(8**k * block.counts[3], 2**21) for k in (3, 2, 1, 0)]  # fmt: skip
    parts = {"counts": tuple(counts), "coordinates": packed_voxels(random), "latent": data(random)}
    some = {
        "blocks": (replace(block, **_some(parts, random)),) * max(min(limit(random, 8), 99), 1),
        "quarter_octaves": limit(random, 8), "points_per_voxel": limit(random, 16),
        "rate": limit(random, 3), "origin": (limit(random, 31), -limit(random, 31), 0),
    }  # fmt: skip
    return replace(coded, **_some(some, random))


def _changed3(coded: Any, random: Random) -> Any:
    part = coded.parts[0]
    fields_of_part = {
        "count": limit(random, 22), "levels": limit(random, 5),
        "top": packed_voxels(random), "symbols": data(random),
    }  # fmt: skip
    changed = replace(part, **_some(fields_of_part, random))
    some = {"parts": (changed,) * max(limit(random, 8), 1), "scale": 2.0 ** limit(random, 9),
            "origin": (limit(random, 31), -limit(random, 31), 0)}  # fmt: skip
    return replace(coded, **_some(some, random))


def _changed4(coded: Any, random: Random) -> Any:
    tree = coded.tree
    size = int(random.choice([1, 7, 63, 64]))
    levels = min(limit(random, 5), 40) if random.random() < 0.5 else len(tree.symbols) // 2
    side = 1 << max(19 - levels, 1)
    row = np.arange(side - size, side)[:, None] if side > size else np.arange(size)[:, None]
    base = np.repeat(row, 3, axis=1)
    if random.random() < 0.5:  # a dense block: the base that costs a decoder most
        base = morton_voxels(np.arange(size))
    parts = {
        "symbols": tuple(data(random) for _ in range(2 * levels + int(random.random() < 0.1))),
        "count": limit(random, 32), "check": limit(random, 32),
    }  # fmt: skip
    changed = replace(tree, **_some(parts, random))
    if random.random() < 0.6:
        occupancy = np.full(size, int(random.choice([255, 255, 1, 0])), np.uint8)
        changed = replace(changed, base=base, occupancy=occupancy)
    some = {"tree": changed, "posq": float(2.0 ** int(random.integers(-24, 15))),
            "offsets": (limit(random, 31), -limit(random, 31), 0)}  # fmt: skip
    return replace(coded, **{"tree": changed, **_some(some, random)})


def _changed5(coded: Any, random: Random) -> Any:
    import lzma
    import zlib

    points = int(random.choice([1, 128, 129, limit(random, 18), coded.points]))
    numbers = bytes(12 * 128 * -(-points // 128))
    pattern = random.integers(0, 256, 64, dtype=np.uint8).tobytes() * (len(numbers) // 64)
    raw = numbers if random.random() < 0.5 else pattern
    packed = (raw, zlib.compress(raw), lzma.compress(raw, preset=0))
    compressor = int(random.choice([0, 1, 2]))
    fitting = {"points": points, "compressor": compressor, "packed": packed[compressor]}
    others = {"packed": data(random), "compressor": limit(random, 7), "check": limit(random, 32),
              "scale": float(2.0 ** int(random.integers(-12, 26)))}  # fmt: skip
    changed = replace(coded, **fitting) if random.random() < 0.5 else coded
    return replace(changed, **_some(others, random))


def _some(changes: dict[str, Any], random: Random) -> dict[str, Any]:
    """One of the changes, or a few."""
    names = random.permutation(list(changes))[: int(random.choice([1, 1, 2, len(changes)]))]
    return {name: changes[name] for name in names}


def puck(streams: Sequence[bytes], random: Random) -> bytes:
    """Turns whose header and parts are at their limits, behind checks that fit."""
    lasers = int(random.choice([1, 2, 16, 32, 64, 128, 129]))
    order = bytes(random.permutation(lasers).astype(np.uint8))
    kinds = limit(random, 2) | int(random.choice([0, 64, 128, 192]))
    layout = bytes([limit(random, 8), limit(random, 8), kinds, lasers]) + order + _filling(random)
    if random.random() < 0.8:  # one that is allowed
        layout = bytes(
            [1 + limit(random, 2), 12, 1 + limit(random, 1), 16, *range(0x10, 0x110, 0x22)]
        )
    whole = _records(streams, random)
    records = [whole[0] if random.random() < 0.5 else Record(RecordKind.LAYOUT, layout)]
    records += _turns(whole, random)
    records.append(Record(RecordKind.GAPS, base_128(limit(random, 12)) + _filling(random)))
    records.append(Record(RecordKind.END, _filling(random)))
    return start() + b"".join(record.packed() for record in records)


def puck_smoothed(streams: Sequence[bytes], random: Random) -> bytes:
    """The same behind the beams of a whole stream, or behind others."""
    magic = streams[0].partition(start())[0]
    layout, beams, *whole = _records(streams, random)
    if random.random() < 0.2:
        cut = int(random.integers(len(beams.body)))
        beams = Record(
            RecordKind.BEAMS, beams.body[:cut] + _filling(random) + beams.body[cut + 4 :]
        )
    records = [layout, beams, *_turns(whole, random), Record(RecordKind.END, b"")]
    return magic + start() + b"".join(record.packed() for record in records)


_CLOUD_KINDS = (
    RecordKind.CLOUD_LAYOUT,
    RecordKind.CLOUD,
    RecordKind.PLACES,
    RecordKind.CHUNKS,
    RecordKind.PAYLOADS,
)


def bag(streams: Sequence[bytes], random: Random) -> bytes:
    """Compressed bags whose clouds, layouts, chunks and rows have numbers at their limits."""
    if random.random() < 0.3:
        return recording(streams, random)
    result: list[Record] = []
    for record in _records(streams, random):
        if record.kind in _CLOUD_KINDS and random.random() < 0.3:
            body, at = record.body, int(random.integers(min(len(record.body), 32)))
            number = base_128(limit(random, 32)) if random.random() < 0.7 else _filling(random)
            body = body[:at] + number + body[at + int(random.integers(4)) :]
            result += [Record(record.kind, body)] * int(random.choice([0, 1, 1, 3, 100]))
        else:
            result.append(record)
    return start() + b"".join(record.packed() for record in result)


def _records(streams: Sequence[bytes], random: Random) -> list[Record]:
    """The records of a whole stream."""
    stream = streams[random.integers(len(streams))]
    return list(read_records(BytesIO(start() + stream.partition(start())[2])))


def _turns(whole: Sequence[Record], random: Random) -> list[Record]:
    """A few turns of their own, or a stream's, some of which have another number or part."""
    turns = [record.body for record in whole if record.kind == RecordKind.TURN]
    if not turns or random.random() < 0.3:
        turns = []
        for _ in range(int(random.integers(1, 4))):
            parts = [_filling(random) for _ in range(int(random.integers(1, 7)))]
            numbers = [1 + limit(random, 12), limit(random, 14)]
            turns.append(_turn(limit(random, 7) | 1, numbers, parts))
        return [Record(RecordKind.TURN, body) for body in turns]
    turns *= int(random.choice([1, 1, 2]))
    share = random.choice([0.1, 0.5])
    return [
        Record(RecordKind.TURN, _changed_turn(body, random) if random.random() < share else body)
        for body in turns
    ]


def _turn(flags: int, numbers: list[int], parts: list[bytes]) -> bytes:
    head = bytes([flags]) + b"".join(map(base_128, numbers))
    return head + b"".join(base_128(len(part)) + part for part in parts)


def _changed_turn(body: bytes, random: Random) -> bytes:
    """A turn with other flags, or one of its numbers or parts another."""
    reader = Reader(body)
    flags = reader.take(1)[0]
    numbers, parts = [reader.number(), reader.number()], []
    while reader.at < len(body):
        parts.append(reader.take(reader.number()))
    place = int(random.integers(3 + len(parts)))
    if place == 0:
        flags = limit(random, 7) | 1
    elif place < 3:
        numbers[place - 1] = limit(random, 14)
    else:
        parts[place - 3] = data(random) if random.random() < 0.5 else _filling(random)
    return _turn(flags, numbers, parts)


def _filling(random: Random) -> bytes:
    """Some bytes: all 0, all 255, or any."""
    length = limit(random, 9)
    if random.random() < 0.5:
        return bytes([255 * int(random.integers(2))]) * length
    return random.bytes(length)


def recording(streams: Sequence[bytes], random: Random) -> bytes:
    """Compressed recordings whose turns, gaps, pages and end are at their limits."""
    from puck.gaps import compress_bytes

    whole = _records(streams, random)
    if random.random() < 0.2:
        return puck(streams, random)

    def gaps(count: int) -> Record:
        runs = [(limit(random, 11), limit(random, 12)) for _ in range(int(random.integers(1, 5)))]
        if random.random() < 0.5:  # as many as there are packets
            runs = [(limit(random, 10), count + 1)]
        size = min(sum(length * times for length, times in runs), 1 << 22)
        lengths = b"".join(base_128(number) for run in runs for number in run)
        raw = base_128(len(runs)) + lengths + bytes([int(random.integers(256))]) * size
        return Record(RecordKind.GAPS, base_128(count) + compress_bytes(raw))

    result: list[Record] = []
    for record in whole:
        if record.kind == RecordKind.GAPS and random.random() < 0.5:
            count = Reader(record.body).number()
            count = count if random.random() < 0.7 else limit(random, 20)
            result += [gaps(count)] * int(random.choice([1, 1, 20]))
        elif record.kind == RecordKind.TURN and random.random() < 0.2:
            body = record.body if random.random() < 0.5 else _changed_turn(record.body, random)
            result += [Record(RecordKind.TURN, body)] * int(random.choice([0, 1, 3, 200]))
        elif record.kind == RecordKind.LAYOUT and random.random() < 0.2:
            links = bytes(limit(random, 12) * 4)
            page = base_128(int(random.choice([511, 512, 4096, 65536, 65537])))
            result += [Record(RecordKind.PAGES, page + compress_bytes(links)), record]
        elif record.kind == RecordKind.END and random.random() < 0.2:
            result.append(Record(RecordKind.END, _filling(random)))
        else:
            result.append(record)
    return start() + b"".join(record.packed() for record in result)


def draco(streams: Sequence[bytes], random: Random) -> bytes:
    """Points, method and flags of the header, and bytes of the decoders' descriptions."""
    from puckbench.codecs.draco import _HEADER

    plain = [each for each in streams if each.startswith(b"DRACO")]  # not shifted ones
    stream = plain[random.integers(len(plain))]
    fields_of = list(_HEADER.unpack_from(stream))
    places = random.permutation([4, 5, 6])[: int(random.choice([1, 1, 1, 3]))]
    for place in places.tolist():
        fields_of[place] = limit(random, {4: 1, 5: 16, 6: 26}[place])
    rest = bytearray(stream[_HEADER.size :])
    for _ in range(int(random.choice([0, 1, 2]))):
        rest[int(random.integers(min(len(rest), 40)))] = limit(random, 8)
    cut = len(rest) if random.random() < 0.6 else int(random.integers(len(rest)))
    return _HEADER.pack(*fields_of) + bytes(rest[:cut]) + (data(random) if cut < len(rest) else b"")


def laz(streams: Sequence[bytes], random: Random) -> bytes:
    """Points, scales and chunks at their limits, before points of a stream or any."""
    from puckbench.codecs.storage import laz as codec

    plain = [each for each in streams if each.startswith(codec.MAGIC)]
    stream = bytearray(plain[random.integers(len(plain))])
    if random.random() < 0.5:
        begin = struct.unpack_from("<I", stream, codec._STARTS_AT + 2)[0] + 8
        stream[begin + int(random.integers(20)) :] = data(random) + bytes(8)
        chunks = len(stream) - 8
        struct.pack_into("<q", stream, begin - 8, chunks)
        struct.pack_into("<II", stream, chunks, 0, int(random.choice([1, 1, 2, 336])))
    if random.random() < 0.7:
        struct.pack_into("<I", stream, codec._STARTS_AT + 13, limit(random, 25))
    if random.random() < 0.2:
        scale = 10.0 ** int(random.integers(-320, 309))
        struct.pack_into("<3d", stream, codec._SCALES_AT, *[scale] * 3)
    return bytes(stream)


def cloudini(streams: Sequence[bytes], random: Random) -> bytes:
    """Counts and resolutions at their limits, before chunks of a stream or of any numbers."""
    head, end, chunks = streams[random.integers(len(streams))].partition(b"\0")
    if random.random() < 0.6:
        head = re.sub(rb"width: \d+", b"width: %d" % limit(random, 33), head)
    if random.random() < 0.3:
        step = f"resolution: {10.0 ** int(random.integers(-50, 45)):.50f}".rstrip("0.")
        head = re.sub(rb"resolution: [\d.]+", step.encode(), head)
    if random.random() < 0.6:
        numbers = b"".join(base_128(limit(random, 66)) for _ in range(int(random.integers(3000))))
        parts = [compressed(each) for each in (numbers, bytes(limit(random, 24)), data(random))]
        parts = [parts[random.integers(len(parts))] for _ in range(int(random.integers(4)))]
        chunks = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return head + end + chunks


def range_images(streams: Sequence[bytes], random: Random) -> bytes:
    """Turns at their limits, with images of other sizes, of a stream or of any bytes."""
    stream = streams[random.integers(len(streams))]
    reader, parts = Reader(stream[9:]), []
    while reader.at < len(reader.body):
        parts.append(reader.take(reader.number()))
    layout, beams, _, azimuths, *images = parts
    turns = int(random.choice([1, 1, 2, 16, limit(random, 12)]))
    blocks = [limit(random, 14) for _ in range(turns)]
    if random.random() < 0.5:
        azimuths = compressed(bytes(2 * sum(blocks)))
    if random.random() < 0.5:
        images = images[:1] * turns
    if random.random() < 0.5:
        place = int(random.integers(len(images))) if images else 0
        images[place : place + 1] = [data(random), bytes(1) + data(random)]
    numbers = base_128(limit(random, 16)) + base_128(turns) + b"".join(map(base_128, blocks))
    numbers = parts[2] if random.random() < 0.3 else numbers
    body = [layout, beams, numbers, azimuths, *images]
    return Framing(stream[:4], 1, "").framed(b"".join(base_128(len(part)) + part for part in body))


def packets(streams: Sequence[bytes], random: Random) -> bytes:
    """Packets of a stream, of one byte or of any, as many as are claimed or others."""
    from puckbench.codecs.registry import CODECS, open_codec

    stream = streams[random.integers(len(streams))]
    codec: Any = open_codec(next(n for n in CODECS.names() if open_codec(n).magic == stream[:4]))
    reader = Reader(stream[9:])
    counts = [reader.number() for _ in range(reader.number())]
    raw = codec._unpacked(reader.rest(), sum(counts) * 1206)
    if random.random() < 0.5:
        raw = raw[:1206] * min(limit(random, 13), 5000)
        counts = [len(raw) // 1206]
    changed = bytearray(raw)
    for _ in range(int(random.choice([0, 1, 5]))):
        if changed:
            changed[int(random.integers(len(changed)))] = limit(random, 8)
    if random.random() < 0.4:
        counts = [limit(random, 17) for _ in range(int(random.choice([0, 1, 2, 300])))]
    numbers = base_128(len(counts)) + b"".join(map(base_128, counts))
    packed = codec._packed(bytes(changed)) if random.random() < 0.8 else data(random)
    return Framing(stream[:4], 1, "").framed(numbers + packed)


def gpcc_attributes(streams: Sequence[bytes], random: Random) -> bytes:
    from tests.support.attribute_streams import with_changed_attributes

    return with_changed_attributes(streams, random)


_NETS = "pcc_networks"
WRITERS: dict[str, Callable[[Sequence[bytes], Random], bytes]] = {
    "primitives": primitives,
    "gpcc": gpcc,
    "gpcc (attributes)": gpcc_attributes,
    "gpcc_angular": gpcc_angular,
    "gpcc_predictive": gpcc_predictive,
    "puck": puck,
    "puck_smoothed": puck_smoothed,
    "puck (recording)": recording,
    "puck (bag)": bag,
    "draco": draco,
    "draco_sequential": draco,
    "laz": laz,
    "cloudini": cloudini,
    "jpegls": range_images,
    "jpegxl": range_images,
    "packets_xz": packets,
    "packets_zstd": packets,
    "pcgcv1_plus": _learned(f"{_NETS}.pcgcv1.stream", _changed1, "write_stream", ["_max_cubes"]),
    "pcgcv2_plus": _learned(f"{_NETS}.pcgcv2.stream", _changed2, "write_coded", ["_check_work"]),
    "sparse_octree_net": _learned(
        f"{_NETS}.octree_net.stream", _changed3, "write_stream", ["_check"]
    ),
    "reno": _learned(f"{_NETS}.reno.stream", _changed4, "write_stream", []),
    "lizip": _learned(f"{_NETS}.lizip.stream", _changed5, "write_stream", ["check_work"]),
}
"""Codecs of our own; `pcgcv1` and `pcgcv2` share the decoders of ours."""
