"""Section 5: from the field to triangles."""
