"""What a proof stands on, whatever it is about: rounding, ranges of coordinates, digests of equations.

Imports nothing of ccpin but `errors` and `arrays`.
"""
