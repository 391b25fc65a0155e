"""From a description to a closed, analysed mechanism."""

from ccpin.mechanism.pinocchio.reader import describe_pinocchio

__all__ = ["describe_pinocchio"]
__dir__ = __all__.copy
