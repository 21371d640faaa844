"""Section 3 for any data: the self-organized fuzzy neural network."""
