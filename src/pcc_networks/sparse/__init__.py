"""Sparse convolutions of voxels, of which PCGCv2, the sparse octree net and RENO are built."""
