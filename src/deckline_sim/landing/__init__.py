"""Landings on a moving deck: what is flown, what the aircraft sees of it, and how it ends."""
