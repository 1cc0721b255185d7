"""Payloads of packet captures and ROS bags."""
