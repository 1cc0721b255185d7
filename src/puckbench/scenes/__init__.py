"""Generated scenes: furnished rooms, objects and calibration targets with labelled triangles."""
