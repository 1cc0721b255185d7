"""Codecs in the formats in which points and returns are stored today: LAZ, differences between
successive points, data packets and range images.
"""
