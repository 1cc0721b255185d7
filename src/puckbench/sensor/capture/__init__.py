"""Captures of a real VLP-16: packet captures and ROS 2 bags read as tables, scans written as packets."""

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
