"""Parametric objects, one function per class: (modeller, member number) -> item of any size."""
