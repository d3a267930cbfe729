"""Writing files: whole or not at all, locks, and folders that belong to one set of settings."""
