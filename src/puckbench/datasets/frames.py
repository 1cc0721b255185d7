from __future__ import annotations

from typing import ClassVar

from pydantic import PositiveInt

from puckbench.datasets.base import FolderSet


class FrameSet(FolderSet):
    """Base class of data sets of LiDAR frames in a folder."""

    of_clouds: ClassVar[bool] = True

    every: PositiveInt = 1
    """Step between the frames that are used, as neighbouring frames are nearly alike."""
    returns: bool = False
    """Whether frames are the sensor's returns, recovered from its points (clouds in metres)."""
    keep_missing: bool = False
    """Whether points that stand for missing returns, at the sensor, are kept."""

    @property
    def of_returns(self) -> bool:
        return self.returns
