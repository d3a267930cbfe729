"""The network: network.py with its branches cover_network.py and mist_branch.py; lens_statistics.py and lenses.py make
what it receives of the other photographs of a lens; size.py counts parameters and operations."""
