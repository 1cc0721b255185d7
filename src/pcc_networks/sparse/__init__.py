"""Sparse 3D convolution in PyTorch, for voxels in Morton order with neighbour tables."""
