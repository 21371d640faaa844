"""Writers of the formats: arrays to binary streams."""
