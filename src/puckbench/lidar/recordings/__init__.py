"""Captures of a real VLP-16 as tables (packet captures, ROS 2 bags), and scans as packets."""

from puckbench.lidar.recordings.capture_table import (
    CaptureTable,
    read_capture_table,
    write_capture_table,
)
from puckbench.lidar.recordings.packets import decode_packets
from puckbench.lidar.recordings.reading import read_capture

__all__ = [
    "CaptureTable",
    "decode_packets",
    "read_capture",
    "read_capture_table",
    "write_capture_table",
]
