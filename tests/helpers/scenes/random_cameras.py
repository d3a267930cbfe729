"""Cameras drawn at random."""

import numpy as np

from hydroviews.scene.alignment import Similarity


def rotations(generator, count):
    """Turns drawn evenly, [count, 3, 3]."""
    q, r = np.linalg.qr(generator.normal(size=(count, 3, 3)))
    q *= np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None]
    q[np.linalg.det(q) < 0, :, 0] *= -1
    return q


def cameras(positions, turns):
    """World-to-camera poses of cameras at positions [N, 3], turned by [N, 3, 3]."""
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, :3] = turns
    poses[:, :3, 3] = -np.einsum("nij,nj->ni", turns, positions)
    return poses


def similarity(generator):
    return Similarity(2.7, rotations(generator, 1)[0], generator.normal(size=3) * 10)
