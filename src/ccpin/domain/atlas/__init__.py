"""Certified atlases of a branch of σ."""
