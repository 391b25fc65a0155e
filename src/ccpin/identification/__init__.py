"""From a robot's log to its model: what can be identified of it, proved as far as structure and exact numbers go.

Needs python-flint (the extra ``validated``), which is imported when a function is called.
"""

from ccpin.identification.identifiable import base_parameters

__all__ = ["base_parameters"]
__dir__ = __all__.copy
