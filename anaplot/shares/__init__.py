"""Shares of work on any executor: processes of this machine, a cluster, what a program brings."""
