"""MJCF, the model files of MuJoCo; read and written."""
