"""Residuals of virtual scans and of error models (thesis chapter 5)."""
