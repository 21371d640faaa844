"""Twins of ``native/orientation``."""
