"""Recordings of sensor data: packet captures and ROS bags, read as payloads."""
