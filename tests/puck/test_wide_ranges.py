"""Returns in millimetres of sensors with up to 128 lasers, by the codecs of returns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointkit.errors import InputError
from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.turns import MAX_RANGE, Layout, Turn
from puck import CodingOptions, decode_returns, encode_returns
from puck.turns import TurnDecoder, TurnEncoder, is_key
from tests.support.returns import staggered

EFFORTS = ("fast", "normal", "thorough")


def same(turn: Turn, other: Turn) -> bool:
    fields = ("ranges", "azimuths", "times", "reflectivities")
    pairs = [(getattr(turn, field), getattr(other, field)) for field in fields]
    is_same = all(np.array_equal(a, b) for a, b in pairs if a is not None or b is not None)
    return is_same and turn.ranges.dtype == other.ranges.dtype


def arbitrary_returns(
    lasers: int, steps: int, columns: int, kinds: int, roughness: int, seed: int
) -> Returns:
    """Two turns whose ranges are a wave with noise up to 2^`roughness`."""
    random = np.random.default_rng(seed)
    order = tuple(random.permutation(lasers).tolist())
    shifts = tuple(random.integers(-40, 41, lasers).tolist()) if seed % 2 else ()
    layout = Layout(order, 1, 16, kinds, steps, shifts)
    turns = []
    for number in range(2):
        wave = np.sin(np.arange(columns)[:, None] / 50 + np.arange(lasers) / 9 + number / 9)
        ranges = (1 << 20) * (1 + wave[None].repeat(kinds, axis=0)) + 1
        ranges += random.integers(0, 1 << roughness, ranges.shape) * (random.random() < 0.8)
        ranges[random.random(ranges.shape) < 0.2] = 0
        turns.append(
            Turn(
                np.minimum(ranges, MAX_RANGE).astype(np.uint32),
                ((number * 3 + np.arange(columns)) % steps).astype(np.uint16),
                random.integers(0, 1 << 32, -(-columns // 16), dtype=np.uint32),
                random.integers(0, 256, ranges.shape, dtype=np.uint8),
            )
        )
    rows = [tuple(row.tolist()) for row in random.normal(0, 20, (6, lasers))]
    beams = Beams(rows[0], rows[1], rows[2], True, rows[3], rows[4], rows[5])
    return Returns(beams, layout, tuple(turns), 0.001, "OS", -0.027670)


@settings(max_examples=25, deadline=None)
@given(
    lasers=st.sampled_from([32, 64, 128]),
    steps=st.sampled_from([512, 1024, 2048, 4096]),
    columns=st.integers(1, 40),
    kinds=st.sampled_from([1, 2]),
    roughness=st.sampled_from([0, 4, 12, 24]),
    effort=st.sampled_from(EFFORTS),
    seed=st.integers(0, 1000),
)
def test_returns_of_32_bits_come_back_exactly(
    lasers: int, steps: int, columns: int, kinds: int, roughness: int, effort: str, seed: int
) -> None:
    returns = arbitrary_returns(lasers, steps, columns, kinds, roughness, seed)
    options = CodingOptions(effort=effort)  # type: ignore[arg-type]
    decoded = decode_returns(encode_returns(returns, options))
    assert replace(decoded, turns=()) == replace(returns, turns=())
    assert all(map(same, returns.turns, decoded.turns))


@pytest.mark.parametrize("effort", EFFORTS)
def test_the_least_predictable_turns_fit_in_their_buffers(effort: str) -> None:
    random = np.random.default_rng(1)
    ranges = random.choice(np.array([1, MAX_RANGE], np.uint32), (2, 256, 128))
    ranges[:, ::2] = random.integers(1, MAX_RANGE + 1, (2, 128, 128))
    turn = Turn(ranges.astype(np.uint32), np.arange(256, dtype=np.uint16))
    layout = Layout(tuple(range(128)), kinds=2, azimuth_steps=1024)
    options = CodingOptions(effort=effort)  # type: ignore[arg-type]
    assert same(TurnDecoder(layout).decode(TurnEncoder(layout, options).encode(turn)), turn)


@pytest.mark.parametrize("step", [2, 7, 4096])
def test_quantised_ranges_of_32_bits_are_near(step: int) -> None:
    ranges = np.array([1, 2, 65535, 65536, 1 << 20, MAX_RANGE - 1, MAX_RANGE], np.uint32)
    turn = Turn(ranges.repeat(20).reshape(1, 20, 7).copy(), np.arange(20, dtype=np.uint16))
    layout = Layout(tuple(range(7)), azimuth_steps=512)
    stream = TurnEncoder(layout, CodingOptions(step)).encode(turn)
    wrong = TurnDecoder(layout).decode(stream).ranges.astype(np.int64) - turn.ranges
    assert np.abs(wrong).max() <= step // 2 + 1


def test_a_turn_of_another_width_is_a_key_turn() -> None:
    layout = Layout((0, 1), azimuth_steps=512)
    narrow = Turn(np.full((1, 9, 2), 700, np.uint16), np.arange(9, dtype=np.uint16))
    wide = replace(narrow, ranges=narrow.ranges.astype(np.uint32))
    encoder, decoder = TurnEncoder(layout), TurnDecoder(layout)
    turns = (narrow, narrow, wide, wide, narrow)
    coded = [encoder.encode(turn) for turn in turns]
    assert [is_key(body) for body in coded] == [True, False, True, False, True]
    assert all(same(decoder.decode(body), turn) for body, turn in zip(coded, turns, strict=True))
    decoder.decode(coded[0])
    with pytest.raises(InputError, match="needs the turn before"):
        decoder.decode(coded[3])


def test_damaged_turns_of_32_bits_are_an_error_or_a_turn() -> None:
    returns = staggered()
    layout = returns.layout
    coded = TurnEncoder(layout).encode(returns.turns[0])
    random, errors = np.random.default_rng(4), 0
    for place in [*range(20), *random.integers(0, len(coded), 60)]:
        changed = bytearray(coded)
        changed[place] ^= 1 << random.integers(8)
        try:
            assert TurnDecoder(layout).decode(bytes(changed)).ranges.max() <= MAX_RANGE
        except InputError:
            errors += 1
    assert errors > 40


@pytest.mark.parametrize("effort", ["normal", "thorough"])
def test_shifts_save_bits_where_lasers_are_staggered(effort: str) -> None:
    returns = staggered()
    options = CodingOptions(effort=effort, reflectivities=False)  # type: ignore[arg-type]
    sizes = []
    for layout in (returns.layout, replace(returns.layout, shifts=())):
        encoder = TurnEncoder(layout, options)
        sizes.append(sum(len(encoder.encode(turn)) for turn in returns.turns))
    assert sizes[0] < 0.98 * sizes[1]
