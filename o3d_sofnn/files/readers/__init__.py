"""Readers, one file per format: with NumPy alone, or in a separate process if they may crash."""
