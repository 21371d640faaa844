"""Twins of ``native/meshing``."""
