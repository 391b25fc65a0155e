"""Straight-line programs of the reduced model."""
