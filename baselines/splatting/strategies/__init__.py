"""How many Gaussians there are: the first ones, and when some are added, moved and removed."""
