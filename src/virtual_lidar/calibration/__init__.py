"""Estimation of the parameters of a LiDAR's range errors from the residuals of planes.

docs/explanation/sensor.md explains the method.
"""
