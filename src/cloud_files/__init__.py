"""Readers and writers of file formats for clouds, meshes, recordings and tables."""
