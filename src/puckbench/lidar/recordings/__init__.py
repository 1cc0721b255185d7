"""Recordings of real sensors: reading packet captures, ROS bags and clouds, writing packets."""

from puckbench.lidar.recordings.packet_turns import decode_packets
from puckbench.lidar.recordings.reading import read_recording
from puckbench.lidar.recordings.returns import (
    RecordedReturns,
    read_returns,
    write_returns,
)

__all__ = [
    "RecordedReturns",
    "decode_packets",
    "read_recording",
    "read_returns",
    "write_returns",
]
