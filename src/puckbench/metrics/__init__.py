"""Metrics of decoded point clouds, and tables made from them."""
