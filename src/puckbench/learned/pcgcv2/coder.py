from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.learned.adaptive_entropy import (
    decode_with_contexts,
    encode_with_contexts,
    factorised_prior,
)
from puckbench.learned.device import device_of
from puckbench.learned.entropy_bottleneck import FrequencyTable
from puckbench.learned.grid_level import voxel_size
from puckbench.learned.pcgcv2 import device_inference, inference
from puckbench.learned.pcgcv2.model import SCALES
from puckbench.learned.pcgcv2.stream import (
    ALL_TOOLS,
    MAX_VOXELS,
    CodedBlock,
    CodingTools,
    Pcgcv2Stream,
)
from puckbench.learned.pcgcv2.weights import Pcgcv2Weights
from puckbench.learned.point_reconstruction import (
    SiblingBlocks,
    joined_blocks,
    points_per_voxel,
    reconstructed_points,
)
from puckbench.learned.range_coding import decode_latent, encode_latent
from puckbench.learned.sparse.thread_pool import ThreadPool, thread_pool
from puckbench.learned.sparse.voxels import (
    AXIS_BITS,
    Keys,
    VoxelSet,
    morton_keys,
    morton_voxels,
    pyramid,
    unique_keys,
)

Integers = NDArray[np.int32]
Triples = NDArray[np.int64]
STRIDE = 2**SCALES


@dataclass(frozen=True)
class Pcgcv2Coder:
    """Coder of voxels at one rate, in blocks of about `max_voxels`; see `codec.encode`."""

    weights: Pcgcv2Weights
    rate: int
    rho: float = 1.0
    max_voxels: int = MAX_VOXELS
    threads: int | None = None
    tools: CodingTools = ALL_TOOLS
    point_reconstruction: bool = True

    def encode(self, voxels: Triples, quarter_octaves: int = 0) -> Pcgcv2Stream:
        """Encode voxels (n, 3) of a grid level, in any order; each duplicate counts as a point."""
        origin = voxels.min(axis=0) // STRIDE * STRIDE
        if (voxels.max(axis=0) - origin).max() >= 2**AXIS_BITS:
            raise InputError(f"the cloud spans more than {2**AXIS_BITS} voxels")
        keys = unique_keys(morton_keys(voxels - origin))
        with thread_pool(self.threads) as pool, torch.no_grad():
            parts = split(keys, self.max_voxels)
            blocks = tuple(self._encode_block(part, pool) for part in parts)
        x, y, z = origin.tolist()
        density = 0
        if self.point_reconstruction:
            density = points_per_voxel(len(voxels), len(keys), self.rho)
        digest = self.weights.digest
        return Pcgcv2Stream(
            digest, self.rate, (x, y, z), blocks, quarter_octaves, self.tools, density
        )

    def decode(self, coded: Pcgcv2Stream) -> Floats:
        with thread_pool(self.threads) as pool, torch.no_grad():
            parts = [self._decode_block(block, coded.tools, pool) for block in coded.blocks]
        points = reconstructed_points(joined_blocks(parts), coded.points_per_voxel)
        shifted: Floats = points + np.array(coded.origin)
        return shifted * voxel_size(coded.quarter_octaves)

    def _encode_block(self, keys: Keys, pool: ThreadPool) -> CodedBlock:
        analyse = inference.analyse if self._on_cpu() else device_inference.analyse
        analysis = analyse(self.weights.model, keys, pool)
        y_hat = np.rint(analysis.y * self._gain()).astype(np.int32)
        stride_1, stride_2, stride_4 = analysis.counts
        kept = max(1, round(self.rho * stride_1))
        counts = (kept, stride_2, stride_4, len(analysis.coarse))
        coordinates = encode_voxels(morton_voxels(analysis.coarse.keys))
        return CodedBlock(counts, coordinates, self._encode_latent(y_hat, analysis.coarse))

    def _encode_latent(self, y_hat: Integers, coarse: VoxelSet) -> bytes:
        if CodingTools.CONTEXT_MIXING in self.tools:
            prior = factorised_prior(self._tables(), len(coarse))
            return encode_with_contexts(y_hat, coarse.neighbours, prior)
        return encode_latent(y_hat, self._tables())

    def _decode_block(
        self, block: CodedBlock, tools: CodingTools, pool: ThreadPool
    ) -> SiblingBlocks:
        coarse = pyramid(_coarse_keys(block), 0, pool)[0][0]
        y_hat = self._decode_latent(block, coarse, tools).astype(np.float32) / self._gain()
        child_per_parent = CodingTools.CHILD_PER_PARENT in tools
        network, counts = self.weights.model, block.counts[:3]
        synthesise = inference.synthesise if self._on_cpu() else device_inference.synthesise
        return synthesise(network, y_hat, coarse, counts, pool, child_per_parent)

    def _decode_latent(self, block: CodedBlock, coarse: VoxelSet, tools: CodingTools) -> Integers:
        if CodingTools.CONTEXT_MIXING in tools:
            prior = factorised_prior(self._tables(), len(coarse))
            return decode_with_contexts(block.latent, coarse.neighbours, prior)
        return decode_latent(block.latent, len(coarse), self._tables())

    def _tables(self) -> tuple[FrequencyTable, ...]:
        return self.weights.tables[self.rate]

    def _gain(self) -> NDArray[np.float32]:
        gain: NDArray[np.float32] = self.weights.model.gain(self.rate).detach().cpu().numpy()
        return gain

    def _on_cpu(self) -> bool:
        return device_of(self.weights.model).type == "cpu"


def _coarse_keys(block: CodedBlock) -> Keys:
    voxels = decode_voxels(block.coordinates, block.counts[3])
    if len(voxels) != block.counts[3] or voxels.min() < 0 or voxels.max() >= 2**AXIS_BITS // STRIDE:
        raise InputError("the stream is damaged (coordinates)")
    keys = unique_keys(morton_keys(voxels))
    if len(keys) != len(voxels):
        raise InputError("the stream is damaged (coordinates)")
    return keys


def split(keys: Keys, max_voxels: int) -> list[Keys]:
    """Split sorted keys into equal parts of about `max_voxels`, between voxels of stride 8."""
    parts = -(-len(keys) // max_voxels)
    borders = np.flatnonzero(np.diff(keys >> 3 * SCALES)) + 1
    targets = np.arange(1, parts) * len(keys) // parts
    cuts = borders[np.minimum(np.searchsorted(borders, targets), len(borders) - 1)]
    return [part for part in np.split(keys, np.unique(cuts)) if len(part)]
