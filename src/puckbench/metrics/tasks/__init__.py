"""Tasks of a robot that measure decoded drives."""
