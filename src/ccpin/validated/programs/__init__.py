"""Certificates of programs: what their arithmetic is sure to do over a region."""
