"""Compare reconstructions: this package, Open3D and MeshLab on the same points.

``o3d-sofnn compare`` and ``demos/compare.py`` are its two faces. `run` reads the inputs, runs every
method in a process of its own, and writes figures (CSV), pictures (PNG) and one HTML report.
"""
