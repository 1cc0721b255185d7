"""A learned octree coder that a CPU can train: a small sparse network predicts occupancy."""
