"""Tasks of a robot, by which decoded drives are measured."""
