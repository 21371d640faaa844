"""The command line ``o3d-sofnn``."""
