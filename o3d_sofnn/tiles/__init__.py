"""Clouds larger than one machine: tiles, learned and meshed one by one, with exact seams."""
