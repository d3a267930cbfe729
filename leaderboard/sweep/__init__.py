"""Many runs in one call: a matrix of methods, scenes, patterns and seeds, here, by Slurm or on a Ray cluster."""
