"""The simulated plotter: motion, hand, protocol, faults, and the line that it is served on."""
