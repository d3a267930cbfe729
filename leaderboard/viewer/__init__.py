"""A trained scene in a browser, and files for other viewers."""
