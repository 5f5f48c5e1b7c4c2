"""The simulated instrument: plates, operator, mistakes, eyepieces, and the demonstration."""
