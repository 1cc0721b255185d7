"""Codecs in storage formats: LAZ, differences between points, data packets, range images."""
