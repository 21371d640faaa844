"""Section 4: triangulation of the zero set, on cubes as large as the data allow."""
