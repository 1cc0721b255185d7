"""Inference of the sparse octree net by PyTorch, on any device.

Sums are exact (see `fixed_point`): frequencies equal those of the compiled layers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from puckbench.learned.device import device_of
from puckbench.learned.octree_net.fixed_point import UNITS
from puckbench.learned.octree_net.layers import Rows
from puckbench.learned.octree_net.model import OctreeNet, SymbolHead, as_index
from puckbench.learned.octree_net.symbols import Frequencies, Symbols, powers_of_two
from puckbench.learned.sparse.convolution import Neighbourhood, neighbourhood_of
from puckbench.learned.sparse.kernel_map import voxel_kernel_map
from puckbench.learned.sparse.thread_pool import ThreadPool
from puckbench.learned.sparse.voxels import NeighbourTable


@dataclass
class DeviceFeatures:
    all: Tensor
    neighbourhood: Neighbourhood | None = None


class DevicePredictor:
    def __init__(self, model: OctreeNet) -> None:
        self.model, self._device = model, device_of(model)
        self._powers = torch.from_numpy(powers_of_two()).to(self._device)

    def root_features(self, count: int) -> DeviceFeatures:
        return DeviceFeatures(self.model.root_features(count).detach())

    @torch.no_grad()
    def convolved(
        self, features: DeviceFeatures, table: NeighbourTable, pool: ThreadPool
    ) -> DeviceFeatures:
        neighbourhood = neighbourhood_of(table, voxel_kernel_map(), pool, self._device)
        return DeviceFeatures(self.model.convolved(features.all, neighbourhood), neighbourhood)

    @torch.no_grad()
    def group(
        self, number: int, rows: Rows, features: DeviceFeatures, table: NeighbourTable
    ) -> DeviceGroup:
        index, neighbourhood = (
            as_index(rows, features.all),
            cast(Neighbourhood, features.neighbourhood),
        )
        selected = self.model.group_features(number, features.all, index, neighbourhood)
        return DeviceGroup(self, number, rows, index, features, selected)

    @torch.no_grad()
    def child_features(
        self, features: DeviceFeatures, slots: Rows, pool: ThreadPool
    ) -> DeviceFeatures:
        return DeviceFeatures(
            self.model.child_features(features.all, as_index(slots, features.all))
        )

    @torch.no_grad()
    def frequencies(self, heads: nn.ModuleList, number: int, features: Tensor) -> Frequencies:
        units = cast(SymbolHead, heads[number])(features) * UNITS
        below = (units.amax(dim=1, keepdim=True) - units).clamp_max(len(self._powers) - 1)
        result: NDArray[Any] = self._powers[below.long()].cpu().numpy()
        return result


@dataclass(frozen=True)
class DeviceGroup:
    network: DevicePredictor
    number: int
    rows: Rows
    index: Tensor
    features: DeviceFeatures
    group_features: Tensor

    def predict_first(self, chunk: slice) -> Frequencies:
        heads = self.network.model.first_heads
        return self.network.frequencies(heads, self.number, self.group_features[chunk])

    @torch.no_grad()
    def predict_second(self, chunk: slice, first: Symbols) -> Frequencies:
        model = self.network.model
        self.group_features[chunk] = model.with_first(
            self.group_features[chunk], as_index(first, self.group_features)
        )
        return self.network.frequencies(model.second_heads, self.number, self.group_features[chunk])

    @torch.no_grad()
    def update(self, chunk: slice, second: Symbols) -> None:
        updated = self.network.model.with_second(
            self.group_features[chunk], as_index(second, self.group_features)
        )
        self.features.all[self.index[chunk]] = updated
