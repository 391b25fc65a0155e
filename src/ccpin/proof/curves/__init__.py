"""Singular curves: tubes that hold one each, and boxes of all coordinates in which there is no other."""
