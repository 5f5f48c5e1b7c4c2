"""Files of other programs: one module a format, with `recognises`, `read` and `write`."""
