"""Published captures over HTTP, out of their archives."""
