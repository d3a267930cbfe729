"""What every command line of the project shares: how commands run and end, messages, processes, names of plugins."""
