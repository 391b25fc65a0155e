"""Control laws for the reduced model."""

from __future__ import annotations

from ccpin.control.laws import ControlLaw, NoTorque, PDFullGravity, PDSimpleGravity, TorqueFunction

__all__ = ["ControlLaw", "NoTorque", "PDFullGravity", "PDSimpleGravity", "TorqueFunction"]
