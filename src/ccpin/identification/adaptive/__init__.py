"""A law that learns constants on the way, and what is proved of it."""
