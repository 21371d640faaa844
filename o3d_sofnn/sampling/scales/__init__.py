"""Stage 2: how wide a local fit has to be, place by place, and how much noise there is."""
