"""Twins of ``native/sampling``."""
