"""Theorem 3: sublevel sets from which a set-point law is proved to reach its goal, and gains for it."""
