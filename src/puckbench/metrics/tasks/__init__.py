"""Tasks of a robot, whose results measure decoded drives."""
