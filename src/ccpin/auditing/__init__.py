"""An auditor of certificates that shares no code with what produced them.

It reads a document (`Atlas.save`), evaluates the closures in it in ball arithmetic (python-flint) by products of
rotations, and proves Theorem N of every box and every gluing anew, by subdivision and mean value forms of its own. Of
ccpin it imports nothing but errors (a test asserts it).
"""

from ccpin.auditing.audit import verify

__all__ = ["verify"]
__dir__ = __all__.copy
