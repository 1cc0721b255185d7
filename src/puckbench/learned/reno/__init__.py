"""RENO as its authors published it: occupancy of voxels, level by level, by a sparse network."""
