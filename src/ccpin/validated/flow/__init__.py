"""One motion: its exact closed start, steps proved one by one, and the singularity that it may be proved to meet."""
