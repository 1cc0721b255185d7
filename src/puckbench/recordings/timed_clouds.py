"""Turns of a drive from clouds whose points have times, such as those of ROS drivers."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.recordings.drives import TURN_SHARE
from puckbench.recordings.message_times import MessagePoints, seconds_of_messages, time_field


class TimedClouds(NamedTuple):
    """Clouds of consecutive turns whose points have times.

    Parameters
    ----------
    clouds
        The points of each turn, with their times as field `TURN_SHARE`.
    starts
        Times at which the turns begin, (number of turns,), in s.
    turn_s
        Duration of a turn, in s.
    """

    clouds: tuple[PointCloud, ...]
    starts: Floats
    turn_s: float


def timed_clouds(clouds: Sequence[PointCloud], stamps_s: Floats, label: str) -> TimedClouds | None:
    """Return clouds with the times of their points, or None if they have no usable times.

    Parameters
    ----------
    clouds
        Clouds of two or more consecutive turns. Fields of points with names such as ``time`` or
        ``t`` are times.
    stamps_s
        Time of each cloud, (number of clouds,), in s.
    label
        Text with which warnings begin.
    """
    name = time_field(clouds[0].fields)
    if name is None or any(name not in cloud.fields or not len(cloud) for cloud in clouds):
        return None
    messages = [
        MessagePoints(
            number,
            round(float(stamp) * 1e9),
            "",
            {**dict(zip("xyz", cloud.xyz.T, strict=True)), name: cloud.fields[name]},
        )
        for number, (cloud, stamp) in enumerate(zip(clouds, stamps_s, strict=True))
    ]
    try:
        seconds, are_timed = seconds_of_messages(messages, None, label)
    except InputError as error:
        logging.getLogger(__name__).warning("%s: %s: times are left out", label, error)
        return None
    if not are_timed:
        return None
    begins = np.array([part.min() for part in seconds])
    turn_s = float(np.median(np.diff(begins)))
    if turn_s <= 0:
        return None
    shares = [np.clip((part - part.min()) / turn_s, 0.0, 1.0) for part in seconds]
    timed = tuple(
        PointCloud(cloud.xyz, fields={TURN_SHARE: share})
        for cloud, share in zip(clouds, shares, strict=True)
    )
    return TimedClouds(timed, stamps_s[0] + begins, turn_s)
