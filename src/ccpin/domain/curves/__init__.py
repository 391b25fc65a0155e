"""Singular curves in tubes that are proved to hold one each, over a region that is searched for them all."""
