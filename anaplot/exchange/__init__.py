"""The block folder and the journal file: input and output only."""
