"""Compare reconstructions: this package, Open3D and MeshLab on the same points.

``o3d-sofnn compare`` and ``demos/compare.py`` use it. `run` reads the inputs, runs every method in
a separate process, and writes figures (CSV), pictures (PNG) and one HTML report.
"""
