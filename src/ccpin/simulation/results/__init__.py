"""What comes of a motion: its trajectory, files, forces in closures and joints, metrics and violated limits."""
