"""Vertices moved to better places, small handles opened, no triangle through another."""
