"""Two or more epochs of one object."""
