"""`puck`: the returns of a spinning LiDAR as what they are, coded without loss or with little.

A turn is an image (lasers by firing columns) of ranges on the sensor's quantum, with the azimuths
of its blocks and, on demand, times and reflectivities. Whole recordings come back bit for bit.
"""
