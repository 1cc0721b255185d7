"""Formats in which points and returns are stored today, as the codecs of that name code them.

LAZ, differences between successive points, data packets and range images.
"""
