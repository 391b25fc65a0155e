"""Pinocchio's own models as descriptions, and a mechanism's closures as its constraint models."""
