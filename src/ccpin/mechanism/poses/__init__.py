"""Poses whose loops are closed: closed from one start, searched from many, told apart and compared."""
