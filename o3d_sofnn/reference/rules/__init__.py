"""Twins of ``native/rules``."""
