"""The same mechanisms in other engines, at their best settings."""


class NotForThisError(Exception):
    """A peer cannot have this mechanism, or is not installed; the message is the clear word."""
