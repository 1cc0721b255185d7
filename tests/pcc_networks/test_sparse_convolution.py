"""Sparse layers against PyTorch's dense ones on a grid that holds the same features."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import conv3d, conv_transpose3d

from pcc_networks.sparse.convolution import (
    GenerativeTransposedConvolution,
    Neighbourhood,
    PointwiseConvolution,
    StridedConvolution,
    convolve,
    neighbourhood_of,
)
from pcc_networks.sparse.gather_scatter import (
    KernelMap,
    TorchGatherScatter,
    block_kernel_map,
    voxel_kernel_map,
)
from pcc_networks.sparse.thread_pool import ThreadPool, thread_pool
from pcc_networks.sparse.voxels import (
    VoxelSet,
    kept_children,
    morton_keys,
    morton_voxels,
    pyramid,
    top_k,
)

SIDE = 16
CHILDREN = np.array([[child & 1, child >> 1 & 1, child >> 2] for child in range(8)])
KERNEL_MAPS = {"voxels": voxel_kernel_map(), "blocks": block_kernel_map()}


def _sets() -> tuple[VoxelSet, VoxelSet]:
    voxels = np.unique(np.random.default_rng(1).integers(0, SIDE // 2, (160, 3)), axis=0)
    sets, _ = pyramid(np.sort(morton_keys(voxels)), scales=1)
    return sets[0], sets[1]


def _positions(kernel_map: KernelMap) -> tuple[VoxelSet, torch.Tensor]:
    """A set, and where each feature of it lies in the dense grid: (n, children, 3)."""
    fine, coarse = _sets()
    if kernel_map.children == 1:
        return fine, torch.from_numpy(morton_voxels(fine.keys)[:, None])
    return coarse, torch.from_numpy(2 * morton_voxels(coarse.keys)[:, None] + CHILDREN)


def _dense(features: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
    grid = torch.zeros(SIDE, SIDE, SIDE, features.shape[-1])
    return grid.index_put((at[..., 2], at[..., 1], at[..., 0]), features).permute(3, 0, 1, 2)[None]


def _sparse(grid: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
    return grid[0].permute(1, 2, 3, 0)[at[..., 2], at[..., 1], at[..., 0]]


def _operands(kernel_map: KernelMap, channels: int, out: int) -> list[torch.Tensor]:
    voxels, _ = _positions(kernel_map)
    maker = torch.Generator().manual_seed(0)
    sizes = [(len(voxels), kernel_map.children, channels), (27, channels, out), (out,)]
    return [torch.randn(size, generator=maker).requires_grad_() for size in sizes]


def _site(
    kernel_map: KernelMap, pool: ThreadPool, gather_scatter: str = "compiled"
) -> Neighbourhood:
    voxels, _ = _positions(kernel_map)
    made = neighbourhood_of(voxels.neighbours, kernel_map, pool)
    table = torch.from_numpy(voxels.neighbours).long()
    return (
        made
        if gather_scatter == "compiled"
        else replace(made, gather_scatter=TorchGatherScatter(table, kernel_map))
    )


@pytest.mark.parametrize("gather_scatter", ["compiled", "torch"])
@pytest.mark.parametrize(("channels", "out"), [(1, 4), (4, 8), (8, 1)])
@pytest.mark.parametrize("name", KERNEL_MAPS)
def test_values_and_gradients_are_those_of_a_dense_convolution(
    name: str, channels: int, out: int, gather_scatter: str
) -> None:
    kernel_map = KERNEL_MAPS[name]
    _, at = _positions(kernel_map)
    features, kernel, bias = _operands(kernel_map, channels, out)
    dense_kernel = kernel.view(3, 3, 3, channels, out).permute(4, 3, 0, 1, 2)
    expected = _sparse(conv3d(_dense(features, at), dense_kernel, bias, padding=1), at)
    weights = torch.randn(expected.shape, generator=torch.Generator().manual_seed(2))
    with thread_pool(2) as pool:
        result = convolve(features, kernel, bias, _site(kernel_map, pool, gather_scatter))
        gradients = torch.autograd.grad((result * weights).sum(), (features, kernel, bias))
    required = torch.autograd.grad((expected * weights).sum(), (features, kernel, bias))
    torch.testing.assert_close(result, expected, rtol=1e-4, atol=1e-4)
    for gradient, dense in zip(gradients, required, strict=True):
        torch.testing.assert_close(gradient, dense, rtol=1e-4, atol=1e-4)


def test_the_strided_convolution_is_a_dense_one() -> None:
    fine, coarse = _sets()
    _, child_maps = pyramid(fine.keys, scales=1)
    down = StridedConvolution(3, 5)
    features = torch.randn(len(fine), 1, 3)
    kernel = down.kernel.view(2, 2, 2, 3, 5).permute(4, 3, 0, 1, 2)
    at = torch.from_numpy(morton_voxels(fine.keys)[:, None])
    dense = conv3d(_dense(features, at), kernel, down.bias, stride=2)
    above = torch.from_numpy(morton_voxels(coarse.keys)[:, None])
    torch.testing.assert_close(down(features, child_maps[0]), _sparse(dense, above))


def test_the_generative_transposed_convolution_is_a_dense_one() -> None:
    _, coarse = _sets()
    up = GenerativeTransposedConvolution(3, 5)
    features = torch.randn(len(coarse), 3)
    kernel = up.kernel.view(2, 2, 2, 3, 5).permute(3, 4, 0, 1, 2)
    above = torch.from_numpy(morton_voxels(coarse.keys)[:, None])
    dense = conv_transpose3d(_dense(features[:, None], above), kernel, up.bias, stride=2)
    at = torch.from_numpy(2 * morton_voxels(coarse.keys)[:, None] + CHILDREN)
    torch.testing.assert_close(up(features), _sparse(dense, at))


def test_pointwise_is_a_product_for_each_voxel() -> None:
    layer = PointwiseConvolution(3, 2)
    features = torch.randn(7, 8, 3)
    expected = torch.nn.functional.linear(features, layer.kernel[0].T, layer.bias)
    torch.testing.assert_close(layer(features), expected)


@pytest.mark.parametrize("name", KERNEL_MAPS)
def test_the_number_of_threads_changes_no_bit(name: str) -> None:
    kernel_map = KERNEL_MAPS[name]
    features, kernel, bias = (operand.detach() for operand in _operands(kernel_map, 8, 4))
    results = []
    for threads in (1, 2, 3):
        with thread_pool(threads) as pool:
            where = replace(_site(kernel_map, pool), chunk_floats=1)
            results.append(convolve(features, kernel, bias, where))
    assert torch.equal(results[0], results[1])
    assert torch.equal(results[0], results[2])


@pytest.mark.parametrize("chunk_floats", [1, 2**12, 2**20])
def test_chunks_change_nothing_but_rounding(chunk_floats: int) -> None:
    features, kernel, bias = (operand.detach() for operand in _operands(block_kernel_map(), 8, 4))
    with thread_pool(1) as pool:
        where = _site(block_kernel_map(), pool)
        whole = convolve(features, kernel, bias, where)
        parts = convolve(features, kernel, bias, replace(where, chunk_floats=chunk_floats))
    torch.testing.assert_close(parts, whole, rtol=1e-5, atol=1e-5)


def test_pytorch_gets_its_threads_back() -> None:
    before = torch.get_num_threads()
    with thread_pool(2):
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before


def test_blocks_waste_no_product() -> None:
    kernel_map = block_kernel_map()
    kernels = kernel_map.kernel_of_pair
    assert np.bincount(kernels).tolist() == [8] * 27


@pytest.mark.parametrize("count", [1, 3, 4, 5, 7, 8])
def test_the_largest_are_kept_and_of_equal_ones_the_first(count: int) -> None:
    logits = np.array([0.5, 2.0, 0.5, -1.0, 0.5, 3.0, 0.5], dtype=np.float32)
    order = sorted(range(len(logits)), key=lambda row: (-logits[row], row))
    assert top_k(logits, count).tolist() == sorted(order[:count])


@pytest.mark.parametrize("count", [1, 3, 5, 6, 17, 40])
def test_every_parent_keeps_its_most_likely_child_before_any_keeps_a_second(count: int) -> None:
    logits = np.random.default_rng(2).normal(size=(5, 8)).round(1).astype(np.float32)
    first = {(parent, int(np.argmax(row))) for parent, row in enumerate(logits)}
    slots = [(parent, child) for parent in range(5) for child in range(8)]
    order = sorted(slots, key=lambda slot: (slot not in first, -logits[slot], slot))
    expected = sorted(8 * parent + child for parent, child in order[:count])
    assert kept_children(logits, count).tolist() == expected
