"""Point clouds, meshes and their geometry: neighbours, planes, Morton order, scaling."""
