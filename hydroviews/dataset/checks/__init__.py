"""Verifying a data set: which files there are, their cameras, their rain, whether it can be drawn again; repairs."""
