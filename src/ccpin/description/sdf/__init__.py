"""The reader of SDFormat, Gazebo's model files."""
