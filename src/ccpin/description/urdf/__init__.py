"""URDF with the dialects that close loops in it, and xacro; read and written."""
