"""Twins of ``native/geometry``."""
