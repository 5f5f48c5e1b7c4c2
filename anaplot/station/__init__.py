"""The running workstation: link, journal and session wired together."""
