from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from puckbench.learned.device import device_of
from puckbench.learned.pcgcv2.inference import AnalysisResult, decoded_blocks
from puckbench.learned.pcgcv2.model import SCALES, PCGCv2
from puckbench.learned.point_reconstruction import SiblingBlocks
from puckbench.learned.sparse.convolution import neighbourhood_of
from puckbench.learned.sparse.kernel_map import block_kernel_map, voxel_kernel_map
from puckbench.learned.sparse.thread_pool import ThreadPool
from puckbench.learned.sparse.voxels import Keys, VoxelSet, pyramid


def analyse(model: PCGCv2, keys: Keys, pool: ThreadPool) -> AnalysisResult:
    device = device_of(model)
    sets, child_maps = pyramid(keys, SCALES, pool)
    neighbourhoods = [
        neighbourhood_of(voxels.neighbours, voxel_kernel_map(), pool, device) for voxels in sets
    ]
    y = model.g_a(neighbourhoods, child_maps, torch.ones(len(keys), 1, 1, device=device))[:, 0]
    counts = (len(sets[0]), len(sets[1]), len(sets[2]))
    return AnalysisResult(y.cpu().numpy(), sets[SCALES], counts)


def synthesise(
    model: PCGCv2,
    y_hat: NDArray[np.float32],
    coarse: VoxelSet,
    counts: Sequence[int],
    pool: ThreadPool,
    child_per_parent: bool = True,
) -> SiblingBlocks:
    device = device_of(model)

    def one_scale(scale: int, features: Tensor, parents: VoxelSet) -> tuple[Tensor, Tensor]:
        neighbourhood = neighbourhood_of(parents.neighbours, block_kernel_map(), pool, device)
        children, logits = model.g_s.scale(scale)(features, neighbourhood)
        return children, logits

    features = torch.from_numpy(y_hat).to(device)
    return decoded_blocks(one_scale, features, coarse, counts, pool, child_per_parent)
