"""PCGCv1 with tiny networks of random weights: properties that hold for all weights."""

import zlib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn.functional import conv3d, conv_transpose3d, pad

from pcc_networks.pcgcv1 import hyper_prior
from pcc_networks.pcgcv1.codec import decode, encode
from pcc_networks.pcgcv1.cubes import cubes_of, occupancy
from pcc_networks.pcgcv1.entropy_coding import decode_counts, encode_counts
from pcc_networks.pcgcv1.hyper_prior import IntegerHyperSynthesis
from pcc_networks.pcgcv1.inference import CpuTransforms
from pcc_networks.pcgcv1.model import HyperSynthesis, Pcgcv1Shape, StridedConv, TransposedConv
from pcc_networks.pcgcv1.stream import BATCH, CubeBatch, Pcgcv1Stream, read_stream, write_stream
from pcc_networks.pcgcv1.weights import Pcgcv1Weights, load_published, load_weights
from pcc_networks.sparse.voxels import top_k
from pointkit.errors import InputError
from tests.support.learned_codecs import (
    TINY1,
    endure_damage,
    network1,
    save_tiny,
    shell,
    torch_threads,
)

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Pcgcv1Weights:
    path = tmp_path_factory.mktemp("folder") / "tiny.safetensors"
    save_tiny("pcgcv1", path)
    return load_weights(path)


def _tensorflow_same(values: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Stride two, padded as TensorFlow documents 'same': what is lacking, more of it at the end."""
    size, taps = len(values), len(kernel)
    out = -(-size // 2)
    lacking = max((out - 1) * 2 + taps - size, 0)
    padded = np.pad(values, (lacking // 2, lacking - lacking // 2))
    return np.array([padded[2 * k : 2 * k + taps] @ kernel for k in range(out)])


def test_strides_pad_as_tensorflow_does() -> None:
    values, kernel = np.arange(1.0, 9), np.array([1.0, 10, 100])
    layer = StridedConv(1, 1, bias=False)
    with torch.no_grad():
        layer.weight.zero_()[0, 0, 0, 0] = torch.from_numpy(kernel)
        cube = torch.zeros(1, 1, 8, 8, 8)
        cube[0, 0, 0, 0] = torch.from_numpy(values)
        result = layer(cube)[0, 0, 0, 0].numpy()
    np.testing.assert_array_equal(result, _tensorflow_same(values, kernel))


def test_the_transposed_convolution_is_the_strided_ones_adjoint() -> None:
    """<up(x), y> = <x, down(y)>: TensorFlow defines one as the gradient of the other."""
    torch.manual_seed(1)
    up, down = TransposedConv(3, 5), StridedConv(5, 3, bias=False)
    with torch.no_grad():
        up.bias.zero_()
        down.weight.copy_(up.weight)
        x, y = torch.randn(1, 3, 4, 4, 4), torch.randn(1, 5, 8, 8, 8)
        torch.testing.assert_close((up(x) * y).sum(), (x * down(y)).sum())


def test_inference_gives_what_the_modules_give() -> None:
    for shape in (
        TINY1,
        TINY1.model_copy(update={"channels": (16, 32, 64), "latent_channels": 16}),
    ):
        model = network1(shape)
        fast = CpuTransforms(model)
        occupied = (np.random.default_rng(0).random((16, 16, 16)) < 0.05).astype(np.float32)
        latent, hyper = fast.analyse(occupied, 1)
        with torch.no_grad():
            exact = model.g_a(torch.from_numpy(occupied)[None, None]) * model.gain(1)
            exact_hyper = model.h_a(exact)
            logits = model.g_s(torch.from_numpy(latent)[None] / model.gain(1))
        assert np.abs(latent - exact[0].numpy()).max() < 0.5 + 1e-3
        assert np.abs(hyper - exact_hyper[0].numpy()).max() < 0.5 + 1e-3
        result = fast.synthesise(latent, 1, np.ones(latent.shape[1:], dtype=bool))
        np.testing.assert_allclose(result, logits.flatten(), atol=1e-4)


@pytest.mark.parametrize("where", [(3, 20, 40), (31, 31, 31), (60, 0, 25)])
def test_empty_parts_of_a_cube_need_not_be_computed(where: tuple[int, int, int]) -> None:
    model = network1(TINY1.model_copy(update={"cube_size": 64}))
    occupied = np.zeros((64, 64, 64), dtype=np.float32)
    occupied[tuple(slice(k, k + 4) for k in where)] = 1
    with torch.no_grad():
        model.log_gains.fill_(8)  # fine steps, so that any difference shows
        latent, _ = CpuTransforms(model).analyse(occupied, 1)
        exact = model.g_a(torch.from_numpy(occupied)[None, None]) * model.gain(1)
    assert np.abs(latent - exact[0].numpy()).max() < 0.5 + 0.1


@pytest.mark.parametrize("where", [(5, 9, 13), (2, 6, 10), (15, 0, 8)])
def test_blocks_outside_the_mask_need_not_be_computed(where: tuple[int, int, int]) -> None:
    model = network1(TINY1.model_copy(update={"cube_size": 64, "blocks": 3}))
    with torch.no_grad():
        for layer in model.g_s.parameters():
            layer.mul_(3)  # so that what is far away counts
    latent = np.random.default_rng(0).integers(-9, 10, (model.shape.latent_channels, 16, 16, 16))
    blocks = np.zeros((16, 16, 16), dtype=bool)
    blocks[where] = True
    result = CpuTransforms(model).synthesise(latent.astype(np.int32), 1, blocks).reshape(64, 64, 64)
    with torch.no_grad():
        exact = model.g_s(torch.from_numpy(latent)[None].float() / model.gain(1))[0, 0].numpy()
    target = tuple(slice(4 * k, 4 * k + 4) for k in where)
    np.testing.assert_allclose(result[target], exact[target], rtol=1e-4, atol=1e-4)
    assert np.isneginf(result).any()


def test_cubes_of_many_extents_are_computed_in_few_shapes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each shape costs megabytes for as long as the process lives."""
    shapes = set()

    def halved(_: CpuTransforms, occupied: np.ndarray) -> torch.Tensor:
        shapes.add(occupied.shape)
        return torch.zeros(1, TINY1.channels[1], *(side // 2 for side in occupied.shape))

    monkeypatch.setattr(CpuTransforms, "_stride_two_dense", halved)
    fast = CpuTransforms(network1(TINY1.model_copy(update={"cube_size": 64})))
    rng = np.random.default_rng(0)
    for _ in range(300):
        low = rng.integers(0, 64, 3)
        high = rng.integers(low, 64) + 1
        occupied = np.zeros((64, 64, 64), dtype=np.float32)
        occupied[tuple(map(slice, low, high))] = 1
        fast.analyse(occupied, 1)
    assert 8 <= len(shapes) <= 27


def _lookalike() -> dict[str, np.ndarray]:
    """Random variables with the authors' names, shapes and layouts."""
    rng = np.random.default_rng(0)
    made: dict[str, np.ndarray] = {}

    def layer(name: str, *shape: int, bias: int = 0) -> None:
        made[f"{name}/kernel"] = rng.normal(size=shape).astype(np.float32)
        if bias:
            made[f"{name}/bias"] = rng.normal(size=bias).astype(np.float32)

    for part, widths in (("analysis", (16, 32, 64)), ("synthesis", (64, 32, 16))):
        for scale, width in enumerate(widths, start=1):
            quarter, half = width // 4, width // 2
            for block in range(1, 4):
                vrn = f"{part}_transform/vrn{scale}_{block}"
                layer(f"{vrn}/conv1_1", 3, 3, 3, width, quarter, bias=quarter)
                layer(f"{vrn}/conv1_2", 3, 3, 3, quarter, half, bias=half)
                layer(f"{vrn}/conv2_1", 1, 1, 1, width, quarter, bias=quarter)
                layer(f"{vrn}/conv2_2", 3, 3, 3, quarter, quarter, bias=quarter)
                layer(f"{vrn}/conv2_3", 1, 1, 1, quarter, half, bias=half)
    layer("analysis_transform/conv_in", 3, 3, 3, 1, 16, bias=16)
    layer("analysis_transform/down_1", 3, 3, 3, 16, 32)
    layer("analysis_transform/down_2", 3, 3, 3, 32, 64)
    layer("analysis_transform/conv_out", 3, 3, 3, 64, 16, bias=16)
    layer("synthesis_transform/deconv_in", 3, 3, 3, 16, 64, bias=64)
    layer("synthesis_transform/up_1", 3, 3, 3, 32, 64, bias=32)
    layer("synthesis_transform/up_2", 3, 3, 3, 16, 32, bias=16)
    layer("synthesis_transform/deconv_out", 3, 3, 3, 16, 1, bias=1)
    for k, (a, b) in enumerate(((16, 16), (16, 16), (16, 8)), start=1):
        layer(f"hyper_encoder/conv{k}", 3, 3, 3, a, b, bias=b)
    sizes = {"1": (8, 16), "2": (16, 16), "3": (16, 32), "4_1": (32, 16), "4_2": (32, 16)}
    for name, (a, b) in sizes.items():
        layer(f"hyper_decoder/conv{name}", 3, 3, 3, a, b, bias=b)
    filters = (1, 3, 3, 3, 1)
    for k, (a, b) in enumerate(pairwise(filters)):
        made[f"estimator/matrix_{k}"] = rng.normal(size=(8, b, a)).astype(np.float32)
        made[f"estimator/bais_{k}"] = rng.normal(size=(8, b, 1)).astype(np.float32)
        made[f"estimator/factor_{k}"] = rng.normal(size=(8, b, 1)).astype(np.float32)
    return made


def test_every_variable_of_the_authors_archive_has_its_place(tmp_path: Path) -> None:
    variables = _lookalike()
    np.savez(tmp_path / "a0.75b3.npz", **variables)
    model = load_published(tmp_path / "a0.75b3.npz")
    assert sum(value.size for value in variables.values()) == 658_449
    theirs = sorted(float(value.sum()) for value in variables.values())
    ours = sorted(float(v.sum()) for n, v in model.state_dict().items() if n != "log_gains")
    assert theirs == pytest.approx(ours, abs=1e-3)
    up, down = variables["synthesis_transform/up_1/kernel"], model.g_s.ups[0].weight
    assert down[7, 5, 0, 1, 2].item() == up[0, 1, 2, 5, 7]  # [d, h, w, out, in]
    kernel = variables["analysis_transform/down_1/kernel"]
    assert model.g_a.downs[0].weight[5, 7, 0, 1, 2].item() == kernel[0, 1, 2, 7, 5]
    result = load_weights(tmp_path / "a0.75b3.npz")
    assert result.lmbdas == (0.75,)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not an archive"])
def test_other_files_are_no_archives(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a2b3.npz").write_bytes(content)
    with pytest.raises(InputError, match="not a NumPy archive"):
        load_published(tmp_path / "a2b3.npz")


def test_an_archive_that_lacks_a_variable_is_refused(tmp_path: Path) -> None:
    variables = _lookalike()
    del variables["hyper_decoder/conv4_2/bias"]
    np.savez(tmp_path / "a2b3.npz", **variables)
    with pytest.raises(InputError, match="not the variables of PCGCv1"):
        load_published(tmp_path / "a2b3.npz")


def _laplace_mass(integer: np.ndarray, location: float, scale: float) -> np.ndarray:
    def below(value: np.ndarray) -> np.ndarray:
        tail = np.exp(-np.abs(value - location) / scale) / 2
        return np.where(value < location, tail, 1 - tail)

    return below(integer + 0.5) - below(integer - 0.5)


@pytest.mark.parametrize("number", [0, 8, 15, 500, 700, 1023])
def test_tables_hold_laplace_probabilities(number: int) -> None:
    table = hyper_prior.laplace_table(number)
    scale = hyper_prior.MIN_SCALE * 2 ** (10 * (number >> 4) / 63)
    integers = table.lowest + np.arange(len(table.frequencies) - 1)
    masses = _laplace_mass(integers, (number & 15) / 16, scale)
    shares = table.frequencies / table.frequencies.sum()
    np.testing.assert_allclose(shares[:-1], masses, atol=3e-6)
    assert masses.sum() > 1 - 2.0**-18


PINNED = 2262421923


def test_the_tables_are_the_same_whole_numbers_everywhere() -> None:
    """A change of any frequency changes the format: streams of old versions would not decode."""
    check = 0
    for number in range(hyper_prior.SCALES * hyper_prior.OFFSETS):
        check = zlib.crc32(
            hyper_prior.laplace_table(number).frequencies.astype("<i4").tobytes(), check
        )
    assert check == PINNED


def test_a_value_gets_the_table_nearest_to_its_distribution() -> None:
    units = hyper_prior.UNITS
    location = np.array([0, round(2.49 * units), round(-0.26 * units), -units])
    scale = np.array([0, round(1.05 * units), 3 * units, 10**9])
    chosen = hyper_prior.build_indexes(location, scale)
    assert chosen.centre.tolist() == [0, 2, -1, -1]
    assert (chosen.table & 15).tolist() == [0, 8, 12, 0]
    levels = 63 * (np.log2([1.05, 3]) + 5) / 10
    assert (chosen.table >> 4).tolist() == [0, *np.rint(levels), 63]


def test_training_likelihood_agrees_with_the_closed_form() -> None:
    integers = np.arange(-5.0, 6)
    result = hyper_prior.likelihood(
        torch.from_numpy(integers), torch.full((11,), 0.3), torch.full((11,), 0.8)
    )
    np.testing.assert_allclose(result, _laplace_mass(integers, 0.3, 0.8), rtol=1e-5)


def test_the_integer_hyper_synthesis_follows_the_network() -> None:
    network = HyperSynthesis(Pcgcv1Shape())
    torch.manual_seed(2)
    hyper = torch.randint(-3, 4, (1, 8, 4, 4, 4))
    with torch.no_grad():
        location, scale = network(hyper.float())
    chosen = IntegerHyperSynthesis(network).tables(hyper[0].numpy().astype(np.int32))
    places = chosen.centre + (chosen.table & 15) / 16
    assert np.abs(places - location[0].numpy()).max() < 1 / 32 + 1e-3
    levels = np.clip(63 * (np.log2(scale[0].numpy()) + 5) / 10, 0, 63)
    assert np.abs((chosen.table >> 4) - levels).max() < 0.5 + 0.1


def test_the_integer_hyper_synthesis_sums_do_not_depend_on_their_order() -> None:
    """The same in extended precision, summed tap by tap: no bit of a sum was rounded away."""
    network = HyperSynthesis(Pcgcv1Shape(hyper_channels=(4, 2), latent_channels=2))
    with torch.no_grad():
        for value in network.parameters():
            value.mul_(30)
    exact = IntegerHyperSynthesis(network)
    features = torch.randint(-(2**23), 2**23, (1, 8, 3, 3, 3)).double()
    result = conv3d(features, exact.heads.kernel, exact.heads.bias, padding=1)[0].numpy()
    padded = pad(features, (1,) * 6)[0].numpy().astype(np.int64)
    kernel = exact.heads.kernel.numpy().astype(np.int64)
    total = np.zeros(result.shape, dtype=np.int64)
    for x, y, z in np.ndindex(3, 3, 3):
        part = padded[:, 2 - x : 5 - x, 2 - y : 5 - y, 2 - z : 5 - z]
        total += np.einsum("oi,ixyz->oxyz", kernel[:, :, 2 - x, 2 - y, 2 - z], part)
    bias = exact.heads.bias.numpy().astype(np.int64)[:, None, None, None]
    assert np.array_equal(result.astype(np.int64), total + bias)


def test_weights_too_large_for_exact_sums_are_refused() -> None:
    network = HyperSynthesis(Pcgcv1Shape())
    with torch.no_grad():
        network.scale.weight.fill_(1e4)
    with pytest.raises(InputError, match="too large for exact sums"):
        IntegerHyperSynthesis(network)


def test_cubes_hold_every_voxel_once() -> None:
    voxels = np.random.default_rng(0).integers(-40, 40, (500, 3))
    cubes = cubes_of(np.vstack([voxels, voxels[:50]]), 16)
    assert np.array_equal(np.unique(cubes.voxels(), axis=0), np.unique(voxels, axis=0))
    assert len(cubes.voxels()) == len(np.unique(voxels, axis=0))
    assert np.array_equal(cubes.positions, np.unique(voxels // 16, axis=0))
    first = occupancy(cubes.keys_of(0), 16)
    assert first.sum() == cubes.counts[0]


def test_equal_logits_are_taken_in_the_order_of_their_keys() -> None:
    logits = np.array([1, 3, 2, 2, 0, 2], dtype=np.float32)
    assert top_k(logits, 3).tolist() == [1, 2, 3]
    assert top_k(logits, 9).tolist() == [0, 1, 2, 3, 4, 5]


def test_counts_come_back_in_few_bytes() -> None:
    counts = [int(c) for c in np.random.default_rng(0).integers(2000, 8000, 200)] + [1, 2**18]
    data = encode_counts(counts, 2**18)
    assert decode_counts(data, len(counts), 2**18) == counts
    assert len(data) < 1.75 * len(counts)


def test_voxels_come_back_in_number_and_place(weights: Pcgcv1Weights) -> None:
    points = shell() + np.array([1000, -500, 0])
    decoded = decode(encode(points, weights, 1, point_reconstruction=False), weights)
    assert len(np.unique(decoded, axis=0)) == len(decoded) == len(points)
    cubes, counts = np.unique(points // 16, axis=0, return_counts=True)
    result, kept = np.unique(decoded // 16, axis=0, return_counts=True)
    assert np.array_equal(result, cubes)
    assert np.array_equal(kept, counts)


def test_a_rate_may_be_coarser_and_keep_more(weights: Pcgcv1Weights) -> None:
    points = shell()
    stream = encode(points, weights, 0, scale=0.5, rho=1.2, point_reconstruction=False)
    decoded = decode(stream, weights)
    voxels = np.unique(np.rint(points / 2), axis=0)
    _, counts = np.unique(voxels // 16, axis=0, return_counts=True)
    kept = np.where(counts < 20, counts, np.rint(1.2 * counts))
    assert len(decoded) == kept.sum()
    assert (decoded % 2 == 0).all()


def test_points_of_sparse_cubes_are_coded_or_dropped(weights: Pcgcv1Weights) -> None:
    few = np.array([[100.0, 100, 100], [101, 102, 103]])
    points = np.vstack([shell(), few])
    decoded = {tuple(row) for row in decode(encode(points, weights, 1), weights)}
    assert {tuple(row) for row in few} <= decoded
    without = encode(points, weights, 1, sparse_cubes=False)
    left = {tuple(row // 16) for row in decode(without, weights)}
    assert not {tuple(row // 16) for row in few} & left
    with pytest.raises(InputError, match="sparse ones are dropped"):
        encode(few, weights, 1, sparse_cubes=False)
    assert np.array_equal(np.unique(decode(encode(few, weights, 1), weights), axis=0), few)


def test_threads_change_neither_the_stream_nor_the_decoded_points(weights: Pcgcv1Weights) -> None:
    points = np.vstack([shell() + shift for shift in ([0, 0, 0], [60, 0, 0], [0, 60, 0])])
    coded, decoded = [], []
    for threads in (1, 2, 3):
        with torch_threads(threads):
            coded.append(encode(points, weights, rate=1))
            decoded.append(decode(coded[0], weights))
    assert coded[0] == coded[1] == coded[2]
    assert read_stream(coded[0]).cubes > BATCH
    assert np.array_equal(decoded[0], decoded[1])
    assert np.array_equal(decoded[0], decoded[2])


def test_a_cube_decodes_alike_whatever_stands_beside_it(weights: Pcgcv1Weights) -> None:
    """The number of cubes coded together changes no cube's points."""
    alone = cubes_of(np.random.default_rng(3).integers(0, 16, (300, 3)), 16).voxels()
    crowd = np.vstack([alone, *(alone // 2 + [16 * k, 0, 0] for k in range(1, 6))])
    item, many = (
        decode(encode(cubes.astype(float), weights, 1, point_reconstruction=False), weights)
        for cubes in (alone, crowd)
    )
    assert np.array_equal(item, many[many[:, 0] < 16])


def test_another_machines_tables_end_in_an_error(weights: Pcgcv1Weights) -> None:
    coded = read_stream(encode(shell(), weights, rate=1))
    batch = replace(coded.batches[0], check=coded.batches[0].check ^ 1)
    with pytest.raises(InputError, match="chose other entropy tables"):
        decode(write_stream(replace(coded, batches=(batch,))), weights)


def _coded() -> Pcgcv1Stream:
    batches = (CubeBatch(7, b"hyper"), CubeBatch(9, b"latent"))
    return Pcgcv1Stream(
        b"12345678", 1, 0.625, 40, True, 12, b"where", b"many", b"few", b"latent", batches
    )


def test_streams_come_back() -> None:
    assert read_stream(write_stream(_coded())) == _coded()


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf"), 1e-300, 1e5])
def test_a_stream_without_a_scale_is_refused(scale: float) -> None:
    with pytest.raises(InputError, match="header"):
        read_stream(write_stream(replace(_coded(), scale=scale)))


def test_a_small_stream_cannot_promise_many_cubes() -> None:
    few = replace(_coded(), cubes=64 + 32 * 40, batches=(CubeBatch(0, b""),) * 42)
    with pytest.raises(InputError, match="too many cubes"):
        write_stream(few)


@pytest.mark.parametrize("seed", range(3))
def test_damaged_streams_end_in_one_clean_error_or_points(
    weights: Pcgcv1Weights, seed: int
) -> None:
    stream = encode(shell(), weights, 1)
    endure_damage(lambda damaged: decode(damaged, weights), stream, check=5, seed=seed)


@pytest.mark.parametrize("stream", [b"", b"PCG1", b"PCG2" + bytes(40)])
def test_foreign_streams_are_refused(weights: Pcgcv1Weights, stream: bytes) -> None:
    with pytest.raises(InputError, match=r"truncated|not a PCGCv1 stream"):
        decode(stream, weights)


def test_transposed_layers_match_torch_on_the_kept_part() -> None:
    torch.manual_seed(3)
    layer = TransposedConv(2, 3)
    x = torch.randn(1, 2, 4, 4, 4)
    whole = conv_transpose3d(x, layer.weight, layer.bias, stride=2)
    assert whole.shape[-1] == 9
    torch.testing.assert_close(layer(x), whole[:, :, :8, :8, :8])
