"""From a description to a closed, analysed mechanism."""
