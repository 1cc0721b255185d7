from typing import TYPE_CHECKING

from puckbench.core.lazy import lazy

if TYPE_CHECKING:
    from puckbench.learned.training.examples import CubeExamples as CubeExamples
    from puckbench.learned.training.loop import BaseTrainer as BaseTrainer
    from puckbench.learned.training.loop import train as train
    from puckbench.learned.training.settings import BaseTraining as BaseTraining
    from puckbench.learned.training.settings import MultiRateTraining as MultiRateTraining

__getattr__, __dir__, __all__ = lazy(
    __name__,
    examples=("CubeExamples",),
    loop=("BaseTrainer", "train"),
    settings=("BaseTraining", "MultiRateTraining"),
)
