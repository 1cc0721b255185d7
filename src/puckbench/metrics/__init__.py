"""Metrics for decoded point clouds, and statistics of results."""
