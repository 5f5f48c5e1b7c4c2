"""A report as one self-contained page: its parts, its sections, its files."""
