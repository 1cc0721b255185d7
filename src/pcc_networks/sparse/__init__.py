"""Sparse 3D convolution in PyTorch: voxels in Morton order, neighbour tables, chunked products."""
