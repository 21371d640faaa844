"""Off-line learning of the rules that come with the package: ``python -m o3d_sofnn.training``."""
