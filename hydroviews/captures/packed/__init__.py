"""Rendered captures that ship with the package: packing, unpacking and their archives."""
