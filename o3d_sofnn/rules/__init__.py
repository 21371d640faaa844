"""Section 3.2 on the surface: the rule base, its inference, growth and refits."""
