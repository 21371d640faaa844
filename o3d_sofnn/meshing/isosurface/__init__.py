"""Section 4: triangles of the zero set, on cubes as large as the data allow."""
