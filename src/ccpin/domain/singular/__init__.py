"""Singular configurations: points and cusps, curves in tubes proved to hold one each, and covers of all of them."""
