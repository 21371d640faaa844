"""Point clouds and meshes in files."""
