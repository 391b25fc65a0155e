"""Geometry from poses: sensors, the fit of all that is measured, and poses that tell most."""
