"""On-line learning: points arrive sweep by sweep, and are absorbed into the cells of a lattice."""
