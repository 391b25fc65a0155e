"""Geometry of the tree cut open and of its closures; no masses."""
