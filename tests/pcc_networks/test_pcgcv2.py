"""PCGCv2 with a tiny network of random weights: properties that hold for all weights."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pcc_networks.catalogue import PCGCV2
from pcc_networks.entropy_bottleneck import (
    EntropyBottleneck,
    FrequencyTable,
    decode_latent,
    encode_latent,
    frequency_tables,
)
from pcc_networks.pcgcv2 import codec as pcgcv2_codec
from pcc_networks.pcgcv2.codec import decode, encode, split
from pcc_networks.pcgcv2.inference import analyse, synthesise
from pcc_networks.pcgcv2.model import SCALES, PCGCv2, Pcgcv2Shape
from pcc_networks.pcgcv2.stream import CodedBlock, Pcgcv2Stream, read_stream, write_coded
from pcc_networks.pcgcv2.weights import _NAMES, Pcgcv2Weights, load_published, load_weights
from pcc_networks.sparse.thread_pool import thread_pool
from pcc_networks.sparse.voxels import (
    kept_children,
    keys_of_slots,
    morton_keys,
    pyramid,
    selected_children,
)
from pcc_networks.weights_file import save_multi_rate
from pointkit.errors import InputError
from tests.support.learned_codecs import (
    TINY2,
    endure_damage,
    network2,
    shell,
    torch_threads,
)


def _shell() -> np.ndarray:
    return 40 + shell((30, 22, 12), 20_000)


KEYS = np.sort(morton_keys(_shell()))


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Pcgcv2Weights:
    return _saved(tmp_path_factory.mktemp("weights") / "tiny.safetensors", "none")


def _saved(path: Path, data: str) -> Pcgcv2Weights:
    save_multi_rate(path, PCGCV2, network2(), (1.0, 4.0), {"data": data})
    return load_weights(path)


def test_fused_layers_give_what_the_modules_give() -> None:
    model = network2()
    with thread_pool(2) as pool, torch.no_grad():
        result = analyse(model, KEYS, pool)
        sets, child_maps = pyramid(KEYS, SCALES)
        latent = model.g_a(sets, child_maps, pool)
        np.testing.assert_allclose(result.y, latent.numpy(), rtol=1e-4, atol=1e-5)
        decoded = synthesise(model, result.y, result.coarse, result.counts, pool)
        features, parents = torch.from_numpy(result.y), sets[SCALES]
        for scale, keep in enumerate(reversed(result.counts)):
            children, logits = model.g_s.scale(scale)(features, parents, pool)
            kept = kept_children(logits.numpy(), keep)
            keys = keys_of_slots(parents.keys, kept)
            features = children.flatten(0, 1)[torch.from_numpy(kept)]
            parents = selected_children(parents, kept)
    assert result.counts == tuple(len(voxels) for voxels in sets[:SCALES])
    found_keys = morton_keys(decoded.voxels())
    assert len(np.intersect1d(found_keys, keys)) > 0.999 * len(keys)  # logits differ by rounding


def test_tables_hold_the_bottlenecks_probabilities() -> None:
    bottleneck = network2().entropy_bottleneck(0)
    for channel, table in enumerate(frequency_tables(bottleneck)):
        integers = table.lowest + np.arange(len(table.frequencies) - 1)
        latent = torch.zeros(len(integers), TINY2.latent_channels)
        latent[:, channel] = torch.from_numpy(integers)
        likelihood = bottleneck.likelihood(latent)[:, channel].detach().numpy()
        shares = table.frequencies / table.frequencies.sum()
        np.testing.assert_allclose(shares[:-1], likelihood, rtol=1e-3, atol=1e-6)
        assert likelihood.sum() == pytest.approx(1, abs=1e-4)


def test_the_bottlenecks_bits_are_those_of_the_range_coder() -> None:
    bottleneck = EntropyBottleneck(2)
    latent = np.rint(np.random.default_rng(0).normal(0, 3, (5000, 2))).astype(np.int32)
    bits = -bottleneck.likelihood(torch.from_numpy(latent).float()).log2().sum().item()
    assert 8 * len(encode_latent(latent, frequency_tables(bottleneck))) == pytest.approx(
        bits, rel=0.01
    )


def test_latents_come_back_even_those_outside_their_table() -> None:
    table = FrequencyTable(-2, np.array([10, 50, 900, 50, 10, 1], dtype=np.int32))
    latent = np.rint(np.random.default_rng(0).normal(0, 2, (500, 3))).astype(np.int32)
    latent[3] = [-30_000, 30_000, 77]
    data = encode_latent(latent, (table,) * 3)
    assert np.array_equal(decode_latent(data, 500, (table,) * 3), latent)


def test_a_set_of_weights_comes_back_from_its_file(weights: Pcgcv2Weights, tmp_path: Path) -> None:
    for name, value in network2().state_dict().items():
        result = weights.model.state_dict()[name]
        torch.testing.assert_close(result, value.half().float(), rtol=0, atol=0)
    assert weights.lmbdas == (1.0, 4.0)
    assert _saved(tmp_path / "b.safetensors", "none").digest == weights.digest
    assert _saved(tmp_path / "c.safetensors", "rooms").digest != weights.digest


def _their_shape(name: str, value: torch.Tensor) -> torch.Tensor:
    """1x1x1 kernels are matrices there, and biases rows."""
    if name.endswith("bias"):
        return value[None]
    return value[0] if len(value) == 1 else value


def _lookalike() -> dict[str, dict[str, torch.Tensor]]:
    """A checkpoint with the authors' names, shapes and random values."""
    state = PCGCv2(Pcgcv2Shape()).state_dict()
    parts: dict[str, dict[str, torch.Tensor]] = {"encoder": {}, "decoder": {}}
    for (part, theirs), ours in _NAMES.items():
        for kind in ("kernel", "bias"):
            value = state[f"{ours}.{kind}"]
            parts[part][f"{theirs}.{kind}"] = _their_shape(kind, torch.randn_like(value))
    kinds = {"_matrices": "matrices", "_biases": "biases", "_factors": "factors"}
    names = [
        (f"{a}.{i}", state[f"entropy_bottlenecks.0.{b}.{i}"])
        for a, b in kinds.items()
        for i in range(4)
    ]
    return {**parts, "entropy_bottleneck": {name: torch.randn_like(v) for name, v in names}}


def test_every_value_of_an_original_checkpoint_has_its_place(tmp_path: Path) -> None:
    checkpoint = _lookalike()
    torch.save(checkpoint, tmp_path / "c8_a025_32000.pth")
    model = load_published(tmp_path / "c8_a025_32000.pth")
    unused = 40  # the published 778,527 count three arrays that the authors' code leaves aside
    assert sum(value.numel() for value in model.parameters()) - 8 + unused == 778_527
    theirs = sorted(float(v.sum()) for part in checkpoint.values() for v in part.values())
    ours = sorted(float(v.sum()) for n, v in model.state_dict().items() if n != "log_gains")
    assert theirs == pytest.approx(ours, abs=1e-3)
    first = checkpoint["decoder"]["block1.2.conv1_1.kernel"]
    assert torch.equal(model.g_s.scale(1).blocks[2].conv1_1.kernel, first)
    assert load_weights(tmp_path / "c8_a025_32000.pth").lmbdas == (0.25,)


def test_denormal_weights_of_a_checkpoint_are_zeros(tmp_path: Path) -> None:
    checkpoint = _lookalike()
    kernel = checkpoint["encoder"]["block1.2.conv1_1.kernel"]
    kernel[3], kernel[4] = 1e-40, 1.2e-38
    torch.save(checkpoint, tmp_path / "c8_a1_32000.pth")
    result = load_published(tmp_path / "c8_a1_32000.pth").g_a.scale(1).blocks[2].conv1_1.kernel
    assert not result[3].any()
    assert torch.equal(result[4:], kernel[4:])


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not a checkpoint"])
def test_other_files_are_no_checkpoints(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "c8_a1_32000.pth").write_bytes(content)
    with pytest.raises(InputError, match="not a checkpoint"):
        load_published(tmp_path / "c8_a1_32000.pth")


def test_a_checkpoint_that_lacks_a_layer_is_refused(tmp_path: Path) -> None:
    checkpoint = _lookalike()
    del checkpoint["decoder"]["up1.kernel"]
    torch.save(checkpoint, tmp_path / "c8_a1_32000.pth")
    with pytest.raises(InputError, match=r"scales\.1\.up"):
        load_published(tmp_path / "c8_a1_32000.pth")


def test_as_many_voxels_come_back_as_went_in_and_near_them(weights: Pcgcv2Weights) -> None:
    points = _shell() + 1000
    for rate in range(len(weights.lmbdas)):
        decoded = decode(encode(points, weights, rate, point_reconstruction=False), weights)
        assert decoded.shape == points.shape
        assert len(np.unique(decoded, axis=0)) == len(points)
        coarse = np.unique(points // 8, axis=0)
        assert {tuple(v) for v in decoded // 8} <= {tuple(v) for v in coarse}


def test_few_points_come_back_as_they_are(weights: Pcgcv2Weights) -> None:
    points = np.random.default_rng(0).random((64, 3)) * 1e6
    decoded = decode(encode(points, weights), weights)
    assert np.array_equal(decoded, np.unique(points, axis=0))


def test_threads_change_neither_the_stream_nor_the_decoded_voxels(weights: Pcgcv2Weights) -> None:
    voxels, coded, decoded = _shell(), [], []
    for threads in (1, 2, 3):
        with torch_threads(threads):
            coded.append(encode(voxels, weights, rate=1))
            decoded.append(decode(coded[0], weights))
    assert coded[0] == coded[1] == coded[2]
    assert np.array_equal(decoded[0], decoded[1])
    assert np.array_equal(decoded[0], decoded[2])


def test_rho_is_the_share_of_voxels_kept(weights: Pcgcv2Weights) -> None:
    voxels = _shell()
    stream = encode(voxels, weights, rate=0, rho=0.5)
    assert len(decode(stream, weights)) == round(0.5 * len(voxels))


def test_large_clouds_are_coded_in_blocks(
    weights: Pcgcv2Weights, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pcgcv2_codec, "MAX_VOXELS", 1500)
    voxels = _shell()
    stream = encode(voxels, weights, rate=0)
    coded = read_stream(stream)
    assert isinstance(coded, Pcgcv2Stream)
    assert len(coded.blocks) == -(-len(voxels) // 1500)
    decoded = decode(stream, weights)
    assert len(np.unique(decoded, axis=0)) == len(voxels)


@pytest.mark.parametrize("most", [1, 700, 5000, 10**6])
def test_blocks_hold_every_voxel_once_and_no_coarse_voxel_twice(most: int) -> None:
    parts = split(KEYS, most)
    assert np.array_equal(np.concatenate(parts), KEYS)
    coarse = [np.unique(part >> 9) for part in parts]
    assert sum(map(len, coarse)) == len(np.unique(KEYS >> 9))
    assert max(map(len, parts)) <= most + 512


def test_clouds_that_span_too_much_are_refused(weights: Pcgcv2Weights) -> None:
    points = np.vstack([_shell(), [[2.0**21, 0, 0]]])
    with pytest.raises(InputError, match="spans more than"):
        encode(points, weights)


def _coded() -> Pcgcv2Stream:
    block = CodedBlock((300, 80, 20, 5), b"abc", b"defg")
    return Pcgcv2Stream(b"12345678", 1, (-8, 0, 16), (block, block))


def test_streams_come_back() -> None:
    assert read_stream(write_coded(_coded())) == _coded()


BAD_COUNTS = {
    "no voxels": (300, 80, 20, 0),
    "more than eight children": (300, 80, 41, 5),
    "fewer than one child": (300, 19, 20, 5),
    "too large": (2**22, 2**20, 2**18, 2**16),
}


@pytest.mark.parametrize("name", BAD_COUNTS)
def test_impossible_counts_are_refused(name: str) -> None:
    coded = _coded()
    wrong = replace(coded.blocks[0], counts=BAD_COUNTS[name])
    with pytest.raises(InputError, match=r"counts per scale|too many voxels"):
        read_stream(write_coded(replace(coded, blocks=(wrong,))))


def test_a_small_stream_cannot_promise_many_voxels() -> None:
    huge = CodedBlock((2**20, 2**18, 2**16, 2**14), b"", b"")
    with pytest.raises(InputError, match="too many voxels"):
        read_stream(write_coded(replace(_coded(), blocks=(huge,) * 3)))


@pytest.mark.parametrize("seed", range(3))
def test_damaged_streams_end_in_one_clean_error_or_points(
    weights: Pcgcv2Weights, seed: int
) -> None:
    stream = encode(_shell(), weights, 1)
    endure_damage(lambda damaged: decode(damaged, weights), stream, check=6, seed=seed)


@pytest.mark.parametrize("stream", [b"", b"PCG2", b"DRACO\x02\x02\x00\x01\x00\x00" + bytes(40)])
def test_foreign_streams_are_refused(weights: Pcgcv2Weights, stream: bytes) -> None:
    with pytest.raises(InputError, match=r"truncated|not a PCGCv2 stream"):
        decode(stream, weights)
