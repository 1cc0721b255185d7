"""Readers of packet captures and ROS bags, which return payloads and messages as bytes."""
