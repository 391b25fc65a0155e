"""MuJoCo's MJCF with equality constraints."""
