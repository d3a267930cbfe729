"""Random generators named by what they draw, so that the order of drawing never matters."""

import hashlib

import numpy as np


def generator(seed: int, *labels: str | int) -> np.random.Generator:
    """The generator for one drawing, e.g. `generator(0, "courtyard", "streak", 1, "view-07")`.

    Args:
        seed: any integer; 0 is a seed like every other.
        labels: what is drawn. Equal seeds and labels give equal numbers on every machine.
    """
    name = "\0".join(str(part) for part in (seed, *labels))
    return np.random.default_rng(int.from_bytes(hashlib.sha256(name.encode()).digest()[:16], "little"))
