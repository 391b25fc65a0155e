"""Descriptions out again: one writer a format."""
