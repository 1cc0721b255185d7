"""Jobs of the sensor study: residuals and points of walls and floors (thesis chapter 5)."""
