"""Toolbox-parallel-robots files: a robot.yaml that closes and motorises the URDF beside it; read and written."""
