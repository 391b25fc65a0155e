"""Theorem 3: certified sublevel sets of a set-point law; and certified bounds of tracking errors."""
