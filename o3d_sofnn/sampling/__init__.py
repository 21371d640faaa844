"""Algorithm 1 and section 3.1: cells, local fits, scale, outliers, typical data."""
