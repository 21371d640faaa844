"""Mesh improvement: better vertex positions, no small handles, no intersecting triangles."""
