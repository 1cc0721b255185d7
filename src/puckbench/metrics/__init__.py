"""Metrics for decoded point clouds, and tables computed from them."""
