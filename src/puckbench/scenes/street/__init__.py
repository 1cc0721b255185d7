"""Streets: ground, houses, planting and fittings, and how they lie along a road.

Houses and fittings stand on z = 0, their front to -y, as furniture does.
"""
