"""Files that are whole or not there, folders with an owner, locks."""
