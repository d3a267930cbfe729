"""What `verify` looks at: which files there are, their cameras, their rain, and whether it can be drawn again."""
