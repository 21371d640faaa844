"""Geometry without point-cloud method: vectors, neighbours, mesh properties."""
