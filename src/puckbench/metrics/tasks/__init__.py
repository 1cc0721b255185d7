"""Tasks of a robot, which decoded drives are measured by."""
