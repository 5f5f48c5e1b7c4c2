"""anaplot: on-line photogrammetric triangulation, every measurement with its redundancy number."""

__version__ = "0.1.0"
