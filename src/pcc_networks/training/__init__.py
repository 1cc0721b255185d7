from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.training.examples import CubeExamples as CubeExamples
    from pcc_networks.training.loop import BaseTrainer as BaseTrainer
    from pcc_networks.training.loop import train as train
    from pcc_networks.training.settings import BaseTraining as BaseTraining
    from pcc_networks.training.settings import MultiRateTraining as MultiRateTraining

__getattr__, __dir__, __all__ = lazy(
    __name__,
    examples=("CubeExamples",),
    loop=("BaseTrainer", "train"),
    settings=("BaseTraining", "MultiRateTraining"),
)
