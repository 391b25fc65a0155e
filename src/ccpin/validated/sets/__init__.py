"""All motions from a box of starts: tubes about one of them, and whether they are proved to arrive."""
