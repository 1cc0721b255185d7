"""Error measurements of the thesis's chapter 5: plane residuals, their statistics, distances."""
