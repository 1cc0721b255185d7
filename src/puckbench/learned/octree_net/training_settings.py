"""The settings of a training of the learned octree coder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import PositiveFloat, PositiveInt

from puckbench.learned.training.settings import BaseTraining

if TYPE_CHECKING:
    from puckbench.geometry.cloud import Floats
    from puckbench.learned.octree_net.examples import OctreeExamples
    from puckbench.learned.octree_net.training import OctreeNetTrainer


class OctreeNetTraining(BaseTraining):
    """A training of the learned octree coder; `cube_size` should be a power of two.

    Parameters
    ----------
    scales
        Scales of the coarsest and of the finest grid that cubes are cut on.
    channels
        Channels of the features.
    convolutions
        Convolutions of a level before its first group of voxels.
    symmetries
        Symmetries of the cube that examples are drawn in: all 48, or the 8 about the vertical axis.
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
        """A new model with its optimiser."""
        import torch

        from puckbench.learned.octree_net.model import OctreeNet, OctreeNetShape
        from puckbench.learned.octree_net.training import OctreeNetTrainer
        from puckbench.learned.sparse.thread_pool import thread_pool
        from puckbench.learned.training.loop import on_device

        torch.manual_seed(self.seed)
        model = OctreeNet(OctreeNetShape(channels=self.channels, convolutions=self.convolutions))
        with thread_pool() as pool:
            yield OctreeNetTrainer(on_device(model), self, pool)

    def examples(self, clouds: Sequence[Floats]) -> OctreeExamples:
        """Cubes of clouds (n, 3) on grids of random scales."""
        from puckbench.learned.octree_net.examples import OctreeExamples

        coarsest, finest = self.scales
        return OctreeExamples(
            clouds, self.cube_size, self.batch_size, seed=self.seed, coarsest=coarsest,
            finest=finest, upright=self.symmetries == 8,
        )  # fmt: skip

    def parameters(self, kept: Mapping[str, Any]) -> Mapping[str, Any]:
        """The parameters of a model from the integers that a set keeps."""
        from puckbench.learned.octree_net.weights import parameters

        return parameters(kept)

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write the model as a set of weights with its card."""
        from puckbench.learned.octree_net.weights import save_weights

        save_weights(path, model, card)
