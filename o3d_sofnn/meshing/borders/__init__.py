"""Where an open surface ends: holes that stay closed, what is cut away, and tidy rims."""
