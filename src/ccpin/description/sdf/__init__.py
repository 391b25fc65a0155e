"""SDFormat, the models of Gazebo and Drake; read and written."""
