"""Profiles, framing, the serial link and the simulated plotter."""
