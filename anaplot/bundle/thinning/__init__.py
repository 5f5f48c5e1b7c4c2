"""A block with fewer tie points: as few rays as keep every part of every photo controlled."""
