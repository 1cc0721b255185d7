"""Jobs of the sensor study (thesis chapter 5)."""
