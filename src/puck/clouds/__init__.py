"""Coding of the points of ROS messages of the type PointCloud2."""
