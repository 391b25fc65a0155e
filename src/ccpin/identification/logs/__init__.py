"""Logs: what was measured, read from files and made smooth."""
