"""Codec of geometric primitives: planes in an octree and surfaces of revolution, noise aware.

`mode_decision.encode` codes points with `settings.Settings`, and `decoder.decode_stream` decodes.
"""
