"""Two epochs of one object."""
