"""Files that record what a device sent: packet captures and ROS bags, read as payloads."""
