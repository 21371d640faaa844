"""Borders of open surfaces: holes that stay closed, parts that are cut away, and tidy rims."""
