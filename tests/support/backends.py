"""Tests that are run on one backend only."""

import pytest

import ccpin

same_on_both = pytest.mark.skipif(ccpin.backend().name != "native", reason="the same lines; the reference takes long")
"""What is tested asks no model (closures, trees and loading are NumPy's alone), or is the Python around the equations
of motion, which the compiled core computes sooner.

So are further cases of what the reference is asked in another test: every identity stays with both.
"""
