"""Inter-LPCM with random weights: its networks, distributions, prediction and stream."""

import math
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn import functional

from pcc_networks.inter_lpcm import decode, encode, encode_turn, load_weights
from pcc_networks.inter_lpcm.mixing import (
    MAX_VALUE,
    ElevationCoder,
    decode_corrections,
    encode_corrections,
)
from pcc_networks.inter_lpcm.networks import ElevationNetwork, RadiusNetwork
from pcc_networks.inter_lpcm.prediction import Reference, _window, reference_of
from pcc_networks.inter_lpcm.stream import read_stream, write_stream
from pcc_networks.inter_lpcm.symbols import (
    Distributions,
    SymbolNetwork,
    SymbolWriter,
    code_length,
    contexts_of,
    symbol_reader,
)
from pcc_networks.inter_lpcm.turn import cartesian, lines_of
from pcc_networks.inter_lpcm.weights import FILES, LpcmWeights
from pointkit.errors import InputError
from tests.support.learned_codecs import endure_damage, lpcm_states, lpcm_turn, save_lpcm

pytestmark = pytest.mark.usefixtures("one_thread")
STEP = 0.02


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive of the authors' repository, with random weights."""
    path = tmp_path_factory.mktemp("lpcm") / "Inter-LPCM-main.zip"
    save_lpcm(path)
    return path


@pytest.fixture(scope="module")
def weights(archive: Path) -> LpcmWeights:
    return load_weights(archive)


ODD = {
    "in no order": np.random.default_rng(1).normal(0, 20, (60, 3)),
    "one point": np.array([[3.0, 4.0, 5.0]]),
    "on the axis": np.array([[0.0, 0, 0], [0, 0, 7], [0, 0, -7], [1e-9, 0, 3], [2, 0, 0]]),
    "equal": np.ones((9, 3)),
}


@pytest.mark.parametrize("name", ["a turn", *ODD])
def test_points_keep_their_order_and_place(weights: LpcmWeights, name: str) -> None:
    points = lpcm_turn() if name == "a turn" else ODD[name]
    coded = encode_turn(points, weights, STEP)
    decoded = decode(coded.stream, weights)
    assert np.abs(decoded.points - points).max() <= STEP / 2 + 1e-9
    for part in ("azimuth", "radius", "elevation", "corrections", "points"):
        assert np.array_equal(getattr(decoded, part), getattr(coded, part))


def test_a_preceding_turn_predicts_and_must_be_the_same(weights: LpcmWeights) -> None:
    points, pose = lpcm_turn(), np.eye(4)
    pose[0, 3] = -0.5
    reference = reference_of(lpcm_turn(seed=1), pose)
    assert len(reference.lines) == 10
    coded = encode_turn(points, weights, STEP, reference)
    alone = encode_turn(points, weights, STEP)
    top = coded.lines.starts[8]
    assert not np.array_equal(coded.radius[:top], alone.radius[:top])
    assert np.array_equal(coded.radius[top:], alone.radius[top:])
    decoded = decode(coded.stream, weights, reference)
    assert np.array_equal(decoded.points, coded.points)
    for other in (None, Reference(reference.lines[:9])):
        with pytest.raises(InputError, match="another preceding turn"):
            decode(coded.stream, weights, other)


def test_a_moved_turn_is_seen_from_the_new_place() -> None:
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # a quarter turn
    (line,) = reference_of(np.array([[4.0, 0, 0], [0, 3, 3]]), pose).lines
    assert line == pytest.approx(np.array([[2000, 0, 4, 0], [4000, 45, 3, 0]]))


def test_lines_end_where_the_azimuth_falls_by_a_tenth_of_a_turn() -> None:
    degrees = np.array([1, 90, 359, 2, 300, 265, 228])
    radians = np.radians(degrees)
    points = np.column_stack(
        [np.cos(radians), np.sin(radians), np.tan(np.radians(-10)) + radians * 0]
    )
    lines = lines_of(points)
    assert lines.starts.tolist() == [0, 3, 6, 7]  # 35 degrees are fewer than 36
    assert lines.azimuth.tolist() == np.rint(degrees / 0.045).astype(int).tolist()
    assert lines.elevation == pytest.approx(np.full(7, -10), abs=1e-4)
    assert np.abs(cartesian(lines) - points).max() < np.radians(0.045) / 2 + 1e-5


def test_long_lines_are_cut_and_refused(weights: LpcmWeights) -> None:
    assert lines_of(np.ones((10_000, 3))).starts.tolist() == [0, 4096, 8192, 10_000]
    content = read_stream(encode(lpcm_turn(1, 5), weights, STEP))
    longer = content.heads._replace(lengths=np.array([4097]))
    stream = write_stream(replace(content, heads=longer, corrections=bytes(4000)))
    with pytest.raises(InputError, match="a line"):
        read_stream(stream)


@pytest.mark.parametrize("length", [20, 33, 500])
def test_the_window_of_a_line_is_around_the_nearest_azimuth(length: int) -> None:
    line = np.column_stack([4 * np.arange(length), np.arange(length), *np.zeros((2, length))])
    for nearest in (0, 3, length // 2, length - 1):
        window = _window(line, 4 * nearest + 1)[:, 1]
        first = min(max(nearest - 10, 0), length - 20)
        assert window.tolist() == list(range(first, first + 20))


def test_a_short_line_repeats_the_nearest_point() -> None:
    line = np.column_stack([[10, 20, 30], [0, 1, 2], *np.zeros((2, 3))])
    assert _window(line, 21)[:, 1].tolist() == [0, *[1] * 18, 2]


@pytest.mark.parametrize(
    ("network", "tensors", "published"),
    [(RadiusNetwork, 92, 2_026_102), (ElevationNetwork, 28, 1_553_144)],
)
def test_the_networks_have_the_size_of_the_published_files(
    network: type[torch.nn.Module], tensors: int, published: int
) -> None:
    state = network().state_dict()
    values = sum(math.prod(value.shape) for value in state.values())
    assert len(state) == tensors
    assert 0 < published - 4 * values < 300 * tensors  # names and alignment


def test_an_elevation_follows_the_authors_formula() -> None:
    """Written out with PyTorch's functions, one step of time after the other."""
    torch.manual_seed(0)
    network = ElevationNetwork().eval()
    state = network.state_dict()
    history = torch.rand(2, 49, 4) * torch.tensor([8000, 20, 80, 63]) - torch.tensor([0, 15, 0, 0])
    azimuth = torch.tensor([100.0, 7000])
    x = torch.stack(
        [
            history[..., 0] / 8000,
            (history[..., 1] + 30) / 30,
            history[..., 2] / 100,
            history[..., 3] / 64,
        ],
        dim=-1,
    )
    known = torch.stack([azimuth / 8000, x[:, -1, 1], torch.zeros(2), x[:, -1, 3]], dim=1)
    for layer in range(3):
        hidden, cell, outputs = torch.zeros(2, 128), torch.zeros(2, 128), []
        for step in range(49):
            gates = functional.linear(
                x[:, step], state[f"lstm.weight_ih_l{layer}"], state[f"lstm.bias_ih_l{layer}"]
            ) + functional.linear(
                hidden, state[f"lstm.weight_hh_l{layer}"], state[f"lstm.bias_hh_l{layer}"]
            )
            enter, keep, new, leave = gates.chunk(4, dim=1)
            cell = keep.sigmoid() * cell + enter.sigmoid() * new.tanh()
            hidden = leave.sigmoid() * cell.tanh()
            outputs.append(hidden)
        x = torch.stack(outputs, dim=1)

    def linear(name: str, values: torch.Tensor) -> torch.Tensor:
        return functional.linear(values, state[f"{name}.weight"], state[f"{name}.bias"])

    attended = functional.scaled_dot_product_attention(
        linear("attention.query", x), linear("attention.key", x), linear("attention.value", x)
    ).mean(dim=1)
    known[:, 2] = linear("linear2", linear("linear1", attended))[:, 0] / 100
    expected = linear("linear5", linear("linear4", linear("linear3", known)))[:, 0]
    with torch.no_grad():
        assert network(history, azimuth) == pytest.approx(expected, abs=1e-5)


def _symbols(count: int = 300, spread: float = 5) -> np.ndarray:
    return np.rint(np.random.default_rng(0).normal(0, spread, count)).astype(np.int64)


def test_distributions_are_the_networks() -> None:
    state = {name: value.double() for name, value in lpcm_states()["azimuth symbols"].items()}
    contexts = contexts_of(_symbols(), 4)
    assert contexts[0].tolist() == [4] * 49
    assert contexts[60, -1] == _symbols()[59]

    def linear(name: str, values: torch.Tensor) -> torch.Tensor:
        return functional.linear(values, state[f"{name}.weight"], state[f"{name}.bias"])

    x = linear("input_fc", torch.from_numpy(contexts.astype(np.float64))).relu()
    for block in range(3):
        name = f"res_blocks.{block}"
        x = (linear(f"{name}.fc2", linear(f"{name}.fc1", x).relu()) + x).relu()
    mean, spread, skew = linear("output_fc", x).T
    deviation = (functional.softplus(spread) + 0.01) * (
        1 + math.pi / 8 * (5 * skew.tanh()).square()
    ).sqrt()
    network = SymbolNetwork(_layers_of("azimuth symbols"))
    made = network.distributions(contexts)
    assert made.mean == pytest.approx(mean.numpy(), abs=0.03)
    assert made.deviation == pytest.approx(deviation.numpy(), abs=0.05)
    alone = network.distributions(contexts[7:8])
    assert alone.mean[0] == made.mean[7]
    assert alone.deviation[0] == made.deviation[7]


def _layers_of(name: str) -> tuple:
    from pcc_networks.inter_lpcm.weights import HEADS, _layers

    return tuple(_layers(lpcm_states()[name], HEADS[name]))


def test_code_lengths_are_those_of_normal_distributions() -> None:
    symbols = np.array([0, 1, -1, 40])
    distributions = Distributions(np.zeros(4), np.array([1.0, 1, 1, 1]))
    at_zero = math.erf(0.5 / math.sqrt(2))
    at_one = (math.erf(1.5 / math.sqrt(2)) - at_zero) / 2
    shares = [at * (1 - 42 / 65536) + 1 / 65536 for at in (at_zero, at_one, at_one, 0)]
    assert code_length(symbols, distributions) == pytest.approx(-sum(map(math.log2, shares)))


def test_the_coders_bytes_are_the_code_length() -> None:
    symbols = _symbols(4000)
    distributions = Distributions(np.full(4000, 0.3), np.full(4000, 5.0))
    writer = SymbolWriter(-40, 40)
    writer.write(symbols, distributions)
    data = writer.written()
    assert 8 * len(data) == pytest.approx(code_length(symbols, distributions), rel=0.005)
    with symbol_reader(data, -40, 40, "test") as reader:
        assert np.array_equal(reader.read(distributions), symbols)
    with pytest.raises(InputError, match="damaged"), symbol_reader(data, -40, 40, "test") as reader:
        reader.read(Distributions(*(values[:10] for values in distributions)))


def test_elevations_of_any_size_decode() -> None:
    symbols = _symbols(90, 3).reshape(10, 9)
    symbols[4, :3] = MAX_VALUE, -MAX_VALUE, 0
    radius = np.random.default_rng(2).integers(-32767, 32768, symbols.shape)
    rows = np.arange(9)[::-1].copy()
    writer = ElevationCoder.writer(9, symbols.size)
    for step, coded in zip(symbols, radius, strict=True):
        writer.code(step, rows, coded)

    def decoded(data: bytes) -> np.ndarray:
        reader = ElevationCoder.reader(9, data)
        result = [reader.code(np.zeros(9, np.int64), rows, coded) for coded in radius]
        reader.check_end()
        return np.array(result)

    assert np.array_equal(decoded(writer.written()), symbols)
    with pytest.raises(InputError, match="damaged"):
        decoded(writer.written()[:40])


def test_corrections_of_any_size_decode() -> None:
    corrections = _symbols(900, 3).reshape(-1, 3)
    corrections[5] = [MAX_VALUE, -MAX_VALUE, 21]
    azimuth = np.arange(300) * 26
    data = encode_corrections(corrections, azimuth)
    assert np.array_equal(decode_corrections(data, azimuth), corrections)
    with pytest.raises(InputError, match="damaged"):
        decode_corrections(data[: len(data) // 2], azimuth)


def test_damaged_streams_end_in_one_error(weights: LpcmWeights) -> None:
    stream = encode(lpcm_turn(3, 5), weights, STEP)
    endure_damage(lambda data: decode(data, weights).points, stream, check=5, seed=3)


def test_points_of_a_machine_that_computes_otherwise_are_refused(weights: LpcmWeights) -> None:
    content = read_stream(encode(lpcm_turn(3, 5), weights, STEP))
    for total in (content.total + 0.01, np.nan, np.inf):
        with pytest.raises(InputError, match="does not compute as"):
            decode(write_stream(replace(content, total=total)), weights)
    decode(write_stream(replace(content, total=content.total + 0.001)), weights)


def test_a_stream_cannot_promise_points_without_bytes(weights: LpcmWeights) -> None:
    content = read_stream(encode(lpcm_turn(3, 5), weights, STEP))
    lengths = np.array([5, 5, 10**6])
    with pytest.raises(InputError, match="too many points for the size"):
        write_stream(replace(content, heads=content.heads._replace(lengths=lengths)))


def test_points_that_cannot_be_coded_are_refused(weights: LpcmWeights) -> None:
    for points, step, message in (
        (np.full((3, 3), np.nan), STEP, "not finite"),
        (np.full((3, 3), 1e6), STEP, "too wide"),
        (np.array([[0.0, 0, 3000], [1, 0, 0]]), STEP, "too wide for steps"),
        (np.array([[1.0, 0, 0], [3000, 0, 0]]), 1.0, "too far from each other"),
        (lpcm_turn(), 0.0, "a step of 0 m"),
    ):
        with pytest.raises(InputError, match=message):
            encode(points, weights, step)


def test_weights_are_read_from_an_archive_or_a_folder(archive: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(archive) as file:
        file.extractall(tmp_path)
    folder = tmp_path / "Inter-LPCM-main"
    assert load_weights(folder).digest == load_weights(archive).digest
    torch.save(lpcm_states()["radius"], folder / FILES["elevation"])
    with pytest.raises(InputError, match=r"epoch_28\.pt: not weights of Inter-LPCM"):
        load_weights(folder)
    (folder / FILES["elevation"]).unlink()
    with pytest.raises(InputError, match="epoch_28"):
        load_weights(folder)


@pytest.mark.parametrize("name", ["radius", "azimuth symbols"])
def test_damaged_weights_are_refused(tmp_path: Path, name: str) -> None:
    states = lpcm_states()
    first = next(iter(states[name]))
    states[name] = {**states[name], first: states[name][first] * np.inf}
    save_lpcm(tmp_path / "a.zip", states)
    with pytest.raises(InputError, match="not finite"):
        load_weights(tmp_path / "a.zip")
    (tmp_path / "a.zip").write_bytes(b"PK")
    with pytest.raises(InputError, match="no archive"):
        load_weights(tmp_path / "a.zip")
