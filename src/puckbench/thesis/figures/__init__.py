"""Figures of the thesis, and figures that set its numbers beside ours."""
