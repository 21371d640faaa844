"""Twins of ``native/implicit``."""
