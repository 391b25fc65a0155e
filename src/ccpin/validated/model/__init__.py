"""The closed loop of a mechanism and its law, recorded as programs with exact constants."""
