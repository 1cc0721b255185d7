"""Codec of geometric primitives: noise-aware planes of all sizes in an octree that shares them."""
