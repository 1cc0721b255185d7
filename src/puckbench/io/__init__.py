"""File formats of clouds, meshes, recordings and tables."""
