"""General geometry: vectors, neighbours, mesh properties."""
