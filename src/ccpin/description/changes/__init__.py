"""What may be changed of a description that was read: parts combined, numbers scaled, a pose or forces stated."""
