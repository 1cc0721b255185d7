"""Estimation of the range errors of a LiDAR from the distances of its points from fitted planes.

docs/explanation/sensor.md explains the method.
"""
