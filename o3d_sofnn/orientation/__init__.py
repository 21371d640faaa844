"""One side for every rule: winding number, viewpoints, sheets, confidence."""
