"""Captures of a real VLP-16 as tables (packet captures, ROS 2 bags), and scans as packets."""

from puckbench.sensor.capture.packets import decode_packets
from puckbench.sensor.capture.reading import read_capture
from puckbench.sensor.capture.table import CaptureTable, read_capture_table, write_capture_table

__all__ = [
    "CaptureTable",
    "decode_packets",
    "read_capture",
    "read_capture_table",
    "write_capture_table",
]
