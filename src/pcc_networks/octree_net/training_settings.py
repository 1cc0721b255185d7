from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import PositiveFloat, PositiveInt

from pcc_networks.training.settings import BaseTraining

if TYPE_CHECKING:
    from pcc_networks.octree_net.examples import OctreeExamples
    from pcc_networks.octree_net.training import OctreeNetTrainer
    from pointkit.geometry.cloud import Floats


class OctreeNetTraining(BaseTraining):
    """Settings for training the sparse octree net; `cube_size` should be a power of two.

    Parameters
    ----------
    scales
        Scales of the coarsest and of the finest grid from which cubes are cut.
    convolutions
        Number of convolutions before the first group of voxels of a level.
    symmetries
        Number of random symmetries of examples: all 48, or the 8 about the vertical axis.
    """

    steps: PositiveInt = 3000
    batch_size: PositiveInt = 2
    cube_size: PositiveInt = 128
    learning_rate: PositiveFloat = 3e-3
    scales: tuple[PositiveFloat, PositiveFloat] = (0.1, 1.1)
    channels: PositiveInt = 32
    convolutions: PositiveInt = 1
    symmetries: Literal[8, 48] = 48

    @contextmanager
    def trainer(self) -> Iterator[OctreeNetTrainer]:
        import torch

        from pcc_networks.octree_net.model import OctreeNet, OctreeNetShape
        from pcc_networks.octree_net.training import OctreeNetTrainer
        from pcc_networks.sparse.thread_pool import thread_pool
        from pcc_networks.training.loop import on_device

        torch.manual_seed(self.seed)
        model = OctreeNet(OctreeNetShape(channels=self.channels, convolutions=self.convolutions))
        with thread_pool() as pool:
            yield OctreeNetTrainer(on_device(model), self, pool)

    def examples(self, clouds: Sequence[Floats]) -> OctreeExamples:
        from pcc_networks.octree_net.examples import OctreeExamples

        coarsest, finest = self.scales
        return OctreeExamples(
            clouds, self.cube_size, self.batch_size, seed=self.seed, coarsest=coarsest,
            finest=finest, upright=self.symmetries == 8,
        )  # fmt: skip

    def parameters(self, tensors: Mapping[str, Any]) -> Mapping[str, Any]:
        from pcc_networks.octree_net.weights import parameters

        return parameters(tensors)

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        from pcc_networks.octree_net.weights import save_weights

        save_weights(path, model, card)
