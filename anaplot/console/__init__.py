"""The terminal application over a station."""
