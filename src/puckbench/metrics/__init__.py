"""Measures of geometric distortion: between point clouds, and against the true surface."""
