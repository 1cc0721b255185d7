"""Models of streets: ground, houses, plants and street furniture, and their layout.

Houses and street furniture stand on z = 0, facing -y.
"""
