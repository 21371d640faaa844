"""Algorithm 2 and section 4: local implicit functions, and the field that blends them."""
