"""The terminal application over a station."""

import os

# Textual draws at the ticks of a clock, which a new table need not wait for. What an event writes
# stays the same: only what was changed is written. It is read when Textual is imported.
os.environ.setdefault("TEXTUAL_FPS", "250")
