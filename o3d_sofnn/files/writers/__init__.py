"""Writers of all formats, from arrays to binary streams."""
