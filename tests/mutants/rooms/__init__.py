"""The table's rooms, an area of the package each."""
