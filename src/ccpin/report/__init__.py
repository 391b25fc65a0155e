"""One self-contained page about any mechanism: what it is, where it holds, its modes, an experiment, its animation."""

from ccpin.report.page import write
from ccpin.report.settings import ReportSettings

__all__ = ["ReportSettings", "write"]
__dir__ = __all__.copy
