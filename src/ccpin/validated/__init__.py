"""Validated integration: enclosures of closed-loop motions that are theorems, and what follows from them.

Needs python-flint (the extra ``validated``), which is imported when a function is called.
"""

from ccpin.validated.flow.enclosing import enclose
from ccpin.validated.programs.certifying import certify_program
from ccpin.validated.programs.program_certificate import ProgramCertificate
from ccpin.validated.sets.move import certify_move
from ccpin.validated.sets.set_enclosure import enclose_set

__all__ = ["ProgramCertificate", "certify_move", "certify_program", "enclose", "enclose_set"]
__dir__ = __all__.copy
