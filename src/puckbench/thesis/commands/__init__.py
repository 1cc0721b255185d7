"""Commands that exist for the thesis: its residual study, its claims, its figures and tables."""
