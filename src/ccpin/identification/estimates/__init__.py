"""Constants from logs: motions that show them, estimates, and what these are worth."""
