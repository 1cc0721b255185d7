"""Claims, published numbers, residual study and figures of the thesis."""
