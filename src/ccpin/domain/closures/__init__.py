"""A mechanism's closures as equations in scalar coordinates, read about a configuration."""
