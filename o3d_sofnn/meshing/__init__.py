"""Section 5: a triangle mesh from the field."""
