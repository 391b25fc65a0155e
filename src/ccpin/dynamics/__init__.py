"""Masses: the free system and the reduced model."""
