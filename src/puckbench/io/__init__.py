"""File formats, each in one place: clouds, meshes, recordings, tables."""
