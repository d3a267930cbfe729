"""pycolmap, without its handler of signals: that prints a stack trace in every process which is ended by SIGTERM."""

from hydroviews.cli.processes import kept_handlers

with kept_handlers():
    import pycolmap

__all__ = ["pycolmap"]
