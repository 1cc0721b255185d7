"""Inference of the sparse octree net by PyTorch, on any device.

Sums are exact (see `fixed_point`): frequencies equal those of the compiled layers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from puckbench.learned.device import device_of
from puckbench.learned.octree_net.fixed_point import UNITS
from puckbench.learned.octree_net.layers import Rows
from puckbench.learned.octree_net.model import OctreeNet, as_index
from puckbench.learned.octree_net.symbols import Frequencies, Symbols, powers_of_two
from puckbench.learned.sparse.convolution import Neighbourhood, neighbourhood_of
from puckbench.learned.sparse.kernel_map import voxel_kernel_map
from puckbench.learned.sparse.thread_pool import ThreadPool
from puckbench.learned.sparse.voxels import NeighbourTable


class DevicePredictor:
    """Predictor by the layers of a model whose parameters need no gradients."""

    def __init__(self, model: OctreeNet) -> None:
        self.model, self._device = model, device_of(model)
        self._powers = torch.from_numpy(powers_of_two()).to(self._device)
        self._neighbourhood: Neighbourhood  # of the level's voxels

    def root_features(self, count: int) -> Tensor:
        return self.model.root_features(count)

    def convolved(self, features: Tensor, table: NeighbourTable, pool: ThreadPool) -> Tensor:
        self._neighbourhood = neighbourhood_of(table, voxel_kernel_map(), pool, self._device)
        return self.model.convolved(features, self._neighbourhood)

    def group(
        self, number: int, rows: Rows, features: Tensor, table: NeighbourTable
    ) -> DeviceGroup:
        index = as_index(rows, features)
        selected = self.model.group_features(number, features, index, self._neighbourhood)
        return DeviceGroup(self, number, index, features, selected)

    def child_features(self, features: Tensor, slots: Rows, pool: ThreadPool) -> Tensor:
        return self.model.child_features(features, as_index(slots, features))

    def frequencies(self, head: nn.Module, features: Tensor) -> Frequencies:
        units = head(features) * UNITS
        below = (units.amax(dim=1, keepdim=True) - units).clamp_max(len(self._powers) - 1)
        result: NDArray[Any] = self._powers[below.long()].cpu().numpy()
        return result


@dataclass(frozen=True)
class DeviceGroup:
    network: DevicePredictor
    number: int
    index: Tensor
    features: Tensor
    group_features: Tensor

    def predict_first(self, chunk: slice) -> Frequencies:
        head = self.network.model.first_heads[self.number]
        return self.network.frequencies(head, self.group_features[chunk])

    def predict_second(self, chunk: slice, first: Symbols) -> Frequencies:
        model, features = self.network.model, self.group_features[chunk]
        features[:] = model.with_first(features, as_index(first, features))
        return self.network.frequencies(model.second_heads[self.number], features)

    def update(self, chunk: slice, second: Symbols) -> None:
        features = self.group_features[chunk]
        updated = self.network.model.with_second(features, as_index(second, features))
        self.features[self.index[chunk]] = updated
