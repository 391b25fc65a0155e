"""A mechanism's closures, dynamics and laws, recorded on a tape with exact constants."""
