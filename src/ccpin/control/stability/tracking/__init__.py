"""Bounds of the tracking error, proved along a reference, where σ is only known to ε."""
