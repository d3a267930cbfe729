"""HydroViews: clean multi-view captures go in, rain with known parameters is added."""

__version__ = "0.2.0"
