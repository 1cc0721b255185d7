"""Generated 3D scenes: rooms, objects, streets and calibration targets with labelled triangles."""
