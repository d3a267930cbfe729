"""Fields on the unit cube: encodings, the hash grid and its kernels, density and colour."""
