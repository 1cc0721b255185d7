"""Parametric objects, one function per class: (workshop, member number) -> item of any size."""
