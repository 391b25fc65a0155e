"""What acts on a mechanism beside its equations: commands, motors, limits, contacts, friction and disturbances."""
