"""Training of the networks: settings, examples that are cut from clouds, and a training loop."""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.training.loop import BaseTrainer as BaseTrainer
    from pcc_networks.training.loop import CubeExamples as CubeExamples
    from pcc_networks.training.loop import OtherTrainingError as OtherTrainingError
    from pcc_networks.training.loop import train as train
    from pcc_networks.training.module import ModuleTraining as ModuleTraining
    from pcc_networks.training.module import TrainedModule as TrainedModule
    from pcc_networks.training.settings import BaseTraining as BaseTraining
    from pcc_networks.training.settings import MultiRateTraining as MultiRateTraining
    from pcc_networks.training.settings import OctreeNetTraining as OctreeNetTraining
    from pcc_networks.training.settings import Pcgcv1Training as Pcgcv1Training
    from pcc_networks.training.settings import Pcgcv2Training as Pcgcv2Training

__getattr__, __dir__, __all__ = lazy(
    __name__,
    loop=("BaseTrainer", "CubeExamples", "OtherTrainingError", "train"),
    module=("ModuleTraining", "TrainedModule"),
    settings=(
        "BaseTraining",
        "MultiRateTraining",
        "OctreeNetTraining",
        "Pcgcv1Training",
        "Pcgcv2Training",
    ),
)
