"""Combinations of constants that motions tell apart: their number, proved from both sides."""
