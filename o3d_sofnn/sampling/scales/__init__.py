"""Stage 2: how wide local fits have to be, region by region, and how much noise there is."""
