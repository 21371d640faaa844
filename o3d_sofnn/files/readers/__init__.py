"""Readers, one file a format: on NumPy alone, or in a process of their own where they may crash."""
