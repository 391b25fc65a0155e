"""Geometry as it was meant: redundant rows that agree up to a file's rounding made to agree exactly (`redundancy`)."""
