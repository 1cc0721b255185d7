"""The codec of a spinning sensor's returns: exact, by turns, the same everywhere."""

from __future__ import annotations

import hashlib
from itertools import pairwise

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.turns import Layout, Turn
from puck import CodingOptions, decode_turns, encode_turns
from puck.recordings.packet_turns import packets_of, split_turns, turn_of
from puck.records import RecordKind, read_records
from puck.turns import TurnDecoder, TurnEncoder
from tests.support.spinning import DUAL, HDL32E, PUCK_HIRES, STRONGEST, VLP16, spin

EFFORTS = ("fast", "normal", "thorough")


def turns_of(packets: np.ndarray) -> tuple[Layout, list[Turn]]:
    parts = list(split_turns(packets))
    return parts[0][0].layout, [turn_of(kind, payloads) for kind, payloads in parts]


def alike(turn: Turn, other: Turn) -> bool:
    pairs = [
        (turn.ranges, other.ranges),
        (turn.azimuths, other.azimuths),
        (turn.times, other.times),
        (turn.reflectivities, other.reflectivities),
    ]
    return all(np.array_equal(a, b) for a, b in pairs if a is not None or b is not None)


@pytest.fixture(scope="module")
def three_turns() -> tuple[Layout, list[Turn]]:
    layout, turns = turns_of(spin(packets=60))
    assert len(turns) > 2
    return layout, turns


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize(
    ("product", "mode"),
    [(VLP16, STRONGEST), (VLP16, DUAL), (PUCK_HIRES, 0x38), (HDL32E, STRONGEST), (HDL32E, DUAL)],
)
def test_turns_come_back_exactly(product: int, mode: int, effort: str) -> None:
    layout, turns = turns_of(spin(product, mode))
    decoded = decode_turns(encode_turns(turns, layout, CodingOptions(effort=effort)))
    assert len(decoded) == len(turns) > 1
    assert all(map(alike, turns, decoded))


@pytest.mark.parametrize("effort", EFFORTS)
def test_numbers_of_any_size_come_back(effort: str) -> None:
    random = np.random.default_rng(1)
    turns = [
        Turn(
            random.integers(0, 65536, (2, 6, 5), dtype=np.uint16),
            random.integers(0, 65536, 3, dtype=np.uint16),
            random.integers(0, 1 << 32, 2, dtype=np.uint32),
            random.integers(0, 256, (2, 6, 5), dtype=np.uint8),
        )
        for _ in range(4)
    ]
    layout = Layout((3, 1, 4, 0, 2), columns_per_block=2, blocks_per_time=2, kinds=2)
    assert all(
        map(alike, turns, decode_turns(encode_turns(turns, layout, CodingOptions(effort=effort))))
    )


@pytest.mark.parametrize("value", [0, 1, 65535])
def test_constant_turns_cost_little(value: int) -> None:
    turn = Turn(np.full((1, 900, 16), value, np.uint16), np.zeros(900, np.uint16))
    stream = encode_turns([turn] * 3, Layout(tuple(range(16))))
    assert all(alike(turn, decoded) for decoded in decode_turns(stream))
    assert len(stream) < 500


def test_packets_are_turns_and_back() -> None:
    packets = spin(HDL32E, DUAL)
    parts = list(split_turns(packets))
    back = [packets_of(kind, turn_of(kind, payloads)) for kind, payloads in parts]
    assert np.array_equal(np.concatenate(back), packets)


def test_the_first_kind_is_the_strongest_return_in_order_of_the_lasers() -> None:
    packets = spin(VLP16, DUAL, packets=1)
    kind, payloads = next(split_turns(packets))
    turn = turn_of(kind, payloads)
    block = packets[0, 100 + 4 : 200].reshape(32, 3)  # the second of the first pair
    distances = block[:, 0] + block[:, 1].astype(int) * 256
    assert turn.ranges[0, :2].ravel().tolist() == distances.tolist()


def test_a_turn_begins_with_the_packet_that_passes_azimuth_zero() -> None:
    _, turns = turns_of(spin(packets=60))
    for before, turn in pairwise(turns):
        edge = np.concatenate([before.azimuths[-1:], turn.azimuths[:12]]).astype(int)
        assert (np.diff(edge) < -18000).any()
    assert sum(len(turn.azimuths) for turn in turns) == 60 * 12


def test_the_turn_before_saves_bits(three_turns: tuple[Layout, list[Turn]]) -> None:
    layout, turns = three_turns
    alone = TurnEncoder(layout).encode(turns[2])
    encoder = TurnEncoder(layout)
    after = [encoder.encode(turn) for turn in turns][2]
    assert len(after) < 0.97 * len(alone)


def test_times_and_reflectivities_are_coded_on_demand(
    three_turns: tuple[Layout, list[Turn]],
) -> None:
    layout, turns = three_turns
    bare = encode_turns(turns, layout, CodingOptions(times=False, reflectivities=False))
    assert len(bare) < 0.8 * len(encode_turns(turns, layout))
    decoded = decode_turns(bare)[1]
    assert decoded.times is None
    assert decoded.reflectivities is None
    assert np.array_equal(decoded.ranges, turns[1].ranges)


@pytest.mark.parametrize(("first", "end"), [(0, 1), (1, 3), (3, 4), (2, None), (5, 9), (9, 12)])
def test_any_turns_can_be_had(first: int, end: int | None) -> None:
    layout, turns = turns_of(spin(packets=120))
    stream = encode_turns(turns, layout, CodingOptions(key_every=2))
    decoded, expected = decode_turns(stream, first, end), turns[first:end]
    assert len(decoded) == len(expected)
    assert all(map(alike, decoded, expected))


def test_only_key_turns_can_be_decoded_alone(three_turns: tuple[Layout, list[Turn]]) -> None:
    layout, turns = three_turns
    encoder = TurnEncoder(layout, CodingOptions(key_every=2))
    coded = [encoder.encode(turn) for turn in turns]
    assert alike(TurnDecoder(layout).decode(coded[2]), turns[2])
    with pytest.raises(InputError, match="needs the turn before"):
        TurnDecoder(layout).decode(coded[1])


def test_time_that_runs_backwards_and_azimuths_that_jump_come_back() -> None:
    packets = spin(packets=30)
    order = np.random.default_rng(2).permutation(30)
    layout, turns = turns_of(packets[order])
    assert all(map(alike, turns, decode_turns(encode_turns(turns, layout))))


def test_a_packet_that_stands_still_makes_turns_of_bounded_length() -> None:
    packets = np.repeat(spin(packets=1), 1500, axis=0)
    layout, turns = turns_of(packets)
    assert [len(turn.azimuths) for turn in turns] == [8184, 8184, 18000 - 2 * 8184]
    assert all(map(alike, turns, decode_turns(encode_turns(turns, layout))))


def whole_numbers() -> tuple[Layout, list[Turn]]:
    """Turns that any machine makes alike."""
    column, laser, step = np.arange(240)[:, None], np.arange(16), np.arange(120)
    turns = []
    for number in range(3):
        noise = (column * 7919 + laser * 104729 + number * 1299709) % 10007 % 11
        ranges = 1500 + abs(column % 120 - 60) * 8 + laser * 20 + noise
        ranges[noise == 3] = 0
        shades = (ranges // 64 + noise) % 256
        turns.append(
            Turn(
                ranges[None].astype(np.uint16),
                (step * 300 + step % 3).astype(np.uint16),
                (np.arange(10) * 1327 + number * 13271).astype(np.uint32),
                shades[None].astype(np.uint8),
            )
        )
    return Layout(tuple(range(16)), columns_per_block=2, blocks_per_time=12), turns


@pytest.mark.parametrize(
    ("effort", "step", "expected"),
    [
        ("fast", 1, "7bbdc983d38a44e3"),
        ("normal", 1, "bf9b10244326b0f0"),
        ("normal", 16, "7843f80eb16a7193"),
        ("thorough", 1, "34b64ab245d34c24"),
    ],
)
def test_the_same_turns_make_the_same_bytes_everywhere(
    effort: str, step: int, expected: str
) -> None:
    layout, turns = whole_numbers()
    options = CodingOptions(effort=effort, step=step)
    stream = encode_turns(turns, layout, options)
    assert stream == encode_turns(turns, layout, options)
    assert hashlib.sha256(stream).hexdigest()[:16] == expected
    if step == 1:
        assert all(map(alike, turns, decode_turns(stream)))


def test_what_does_not_fit_is_refused(three_turns: tuple[Layout, list[Turn]]) -> None:
    layout, turns = three_turns
    with pytest.raises(InputError, match="ranges of a turn are"):
        encode_turns(turns, Layout(tuple(range(32))))
    with pytest.raises(InputError, match="effort 'best'"):
        CodingOptions(effort="best")
    with pytest.raises(InputError, match="step 0"):
        CodingOptions(step=0)
    with pytest.raises(ValueError, match="no permutation"):
        Layout((0, 0))
    empty = Turn(np.zeros((1, 0, 16), np.uint16), np.zeros(0, np.uint16))
    with pytest.raises(InputError, match="a turn of 0 blocks"):
        encode_turns([empty], layout)


def test_damaged_streams_end_in_one_error(three_turns: tuple[Layout, list[Turn]]) -> None:
    layout, turns = three_turns
    stream = encode_turns(turns[:2], layout)
    random = np.random.default_rng(3)
    for end in random.integers(0, len(stream), 40):
        with pytest.raises(InputError):
            decode_turns(stream[:end])
    for place in random.integers(0, len(stream), 100):
        changed = bytearray(stream)
        changed[place] ^= 1 << random.integers(8)
        with pytest.raises(InputError):
            decode_turns(bytes(changed))


def test_a_damaged_turn_behind_a_fitting_check_is_an_error_or_a_turn(
    three_turns: tuple[Layout, list[Turn]],
) -> None:
    layout, turns = three_turns
    coded = TurnEncoder(layout).encode(turns[0])
    random, errors = np.random.default_rng(4), 0
    for place in [*range(40), *random.integers(0, len(coded), 150)]:
        changed = bytearray(coded)
        changed[place] ^= 1 << random.integers(8)
        try:
            assert TurnDecoder(layout).decode(bytes(changed)).ranges.shape[2] == layout.lasers
        except InputError:
            errors += 1
    assert errors > 100


def test_a_stream_is_records_with_an_end(three_turns: tuple[Layout, list[Turn]]) -> None:
    from io import BytesIO

    layout, turns = three_turns
    kinds = [record.kind for record in read_records(BytesIO(encode_turns(turns, layout)))]
    assert kinds == [RecordKind.LAYOUT, *[RecordKind.TURN] * len(turns), RecordKind.END]


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("mode", [STRONGEST, DUAL])
@pytest.mark.parametrize("step", [2, 5, 8, 50])
def test_quantised_ranges_are_near_and_none_is_lost(effort: str, mode: int, step: int) -> None:
    layout, turns = turns_of(spin(VLP16, mode))
    decoded = decode_turns(encode_turns(turns, layout, CodingOptions(effort=effort, step=step)))
    for turn, other in zip(turns, decoded, strict=True):
        wrong = turn.ranges.astype(int) - other.ranges
        assert np.array_equal(turn.ranges > 0, other.ranges > 0)
        assert np.abs(wrong).max() <= (step + 1) // 2
        assert np.array_equal(turn.reflectivities, other.reflectivities)


@pytest.mark.parametrize("effort", EFFORTS)
def test_optimised_ranges_cost_less_at_a_smaller_error(effort: str) -> None:
    layout, turns = turns_of(spin(packets=150, rise=60))

    def coded(step: int, lmbda: float) -> tuple[int, float, int]:
        asked = CodingOptions(step, lmbda, times=False, reflectivities=False, effort=effort)
        stream = encode_turns(turns, layout, asked)
        pairs = zip(turns, decode_turns(stream), strict=True)
        wrong = np.concatenate([(a.ranges.astype(int) - b.ranges).ravel() for a, b in pairs])
        return len(stream), float(np.mean(wrong**2)), int(np.abs(wrong).max())

    size, error, most = coded(8, 6.0)
    plain_size, plain_error, _ = coded(9, 0.0)
    assert most <= 12  # one step and a half
    assert error < plain_error
    assert size < plain_size


def test_of_two_multiples_as_near_the_cheaper_one_is_taken_at_any_lambda() -> None:
    """Odd ranges lie in the middle of steps of two: the error stays as it is."""
    layout, turns = turns_of(spin(packets=150))
    coded = {}
    for lmbda in (0.0, 1e-6):
        asked = CodingOptions(2, lmbda, times=False, reflectivities=False)
        stream = encode_turns(turns, layout, asked)
        pairs = zip(turns, decode_turns(stream), strict=True)
        wrong = np.concatenate([(a.ranges.astype(int) - b.ranges).ravel() for a, b in pairs])
        coded[lmbda] = len(stream), int(np.sum(wrong**2))
    assert coded[1e-6][1] == coded[0.0][1]
    assert coded[1e-6][0] < coded[0.0][0]


def test_the_ends_of_what_a_range_can_be_are_kept() -> None:
    ranges = np.zeros((1, 40, 2), np.uint16)
    ranges[0, :, 0], ranges[0, :, 1] = 1, 65535
    turn = Turn(ranges, np.arange(0, 800, 20, dtype=np.uint16))
    for step in (1, 3, 7, 4096):
        decoded = decode_turns(encode_turns([turn], Layout((0, 1)), CodingOptions(step=step)))[0]
        assert (decoded.ranges > 0).all()
        assert np.abs(decoded.ranges.astype(int) - ranges).max() <= step // 2 + 1


def test_streams_of_reflectivities_coded_with_full_mixing_at_every_effort_decode_still(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    layout, turns = whole_numbers()
    lean = encode_turns(turns, layout, CodingOptions(effort="fast"))
    with monkeypatch.context() as patch:
        patch.setattr("puck.turns._LEAN", 0)
        full = encode_turns(turns, layout, CodingOptions(effort="fast"))
    assert full != lean
    assert all(map(alike, turns, decode_turns(full)))
