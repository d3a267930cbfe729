"""The data set on disk: build, open, verify, describe."""
