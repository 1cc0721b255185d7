"""Recordings of sensors as files hold them: packet captures and ROS bags, as payloads."""
