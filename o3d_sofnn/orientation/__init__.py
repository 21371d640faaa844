"""Orientation of the rules: winding number, viewpoints, sheets, confidence."""
