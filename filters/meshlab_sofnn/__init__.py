"""SOFNN normals and surfaces as filters for PyMeshLab.

`reconstruct` and `estimate_normals` work on a ``pymeshlab.MeshSet`` and change nothing else in
PyMeshLab. `register` makes the same two filters callable by name, as
``ms.generate_surface_reconstruction_sofnn(...)``, ``ms.compute_normal_for_point_clouds_sofnn(...)``
and through ``ms.apply_filter``; `unregister` takes that back. Importing this package registers
nothing.

The algorithm is in ``o3d_sofnn``, which never imports PyMeshLab. PyMeshLab is under the GPL 3, and
so, as a whole, is any program that combines it with this package.
"""

from meshlab_sofnn.filters import estimate_normals, reconstruct
from meshlab_sofnn.registration import register, unregister

__all__ = ["estimate_normals", "reconstruct", "register", "unregister"]
