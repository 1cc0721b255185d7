from __future__ import annotations

from typing import ClassVar

from pydantic import PositiveInt

from puckbench.scene_sets.base import FolderSet


class FrameSet(FolderSet):
    """Base class of data sets of LiDAR frames, i.e. single revolutions, in a folder."""

    of_clouds: ClassVar[bool] = True

    every: PositiveInt = 1
    """Use every n-th frame, as neighbouring frames are nearly alike."""
    returns: bool = False
    """Whether to recover the sensor's returns from the points; by default, scenes are clouds."""
    keep_missing: bool = False
    """Whether to keep missing returns, which are points at the sensor's position."""

    @property
    def of_returns(self) -> bool:
        return self.returns
