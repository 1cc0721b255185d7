"""Parametric objects: each class has a function, which makes the item with a member number."""
