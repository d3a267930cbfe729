"""Which pairs of views are worth matching: those with most features in common, and neighbours in time.

A global descriptor of each view, VLAD (Jegou et al., Aggregating local descriptors into a compact image
representation, CVPR 2010), leaves a few partners of which features are compared, so that the cost grows linearly.
"""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.captures.sfm.features import Features
from hydroviews.captures.sfm.learned.mutual import mutual_best
from hydroviews.captures.sfm.pairs import Pair
from hydroviews.captures.sfm.sequence import NEAR
from hydroviews.scene.seeds import generator

COMPARED = 512  # the strongest features of each view
ALIKE = 0.82  # cosine between descriptors of mutual nearest neighbours
BEST = 10  # partners of each view
SHORTLISTED = 60  # partners of each view whose features are compared
WORDS = 32  # of the vocabulary of global descriptors
SAMPLED = 200  # descriptors for each word that the vocabulary is made of
ROUNDS = 10  # of k-means


def ranked_pairs(views: Sequence[Features], still: float) -> set[Pair]:
    """Each view with its best partners and its neighbours in time.

    Args:
        views: the features of each, the strongest first.
        still: pixels; features that moved no further may stay on the lens, and do not count.

    Returns:
        Pairs of indices, the smaller first.
    """
    count = len(views)
    near = {(i, i + step) for step in range(1, NEAR + 1) for i in range(count - step)}
    common = common_features(views, still, shortlist(views))
    partners: list[list[tuple[int, int]]] = [[] for _ in views]
    for (i, j), number in common.items():
        partners[i].append((-number, j))
        partners[j].append((-number, i))
    best = {(min(i, j), max(i, j)) for i, found in enumerate(partners) for number, j in sorted(found)[:BEST] if number}
    return near | best


def common_features(views: Sequence[Features], still: float, pairs: set[Pair]) -> dict[Pair, int]:
    """How many mutual nearest neighbours that moved the views of each pair have."""
    places = [torch.from_numpy(view.keypoints[:COMPARED]) for view in views]
    descriptors = [torch.from_numpy(view.descriptors[:COMPARED]) for view in views]
    common = {}
    for i, j in tqdm(sorted(pairs), desc="ranking", unit="pair"):
        own, others = mutual_neighbours(descriptors[i], descriptors[j])
        common[i, j] = int(((places[i][own] - places[j][others]).norm(dim=1) > still).sum())
    return common


def mutual_neighbours(first: torch.Tensor, second: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Indices [M] of descriptors [K, 64] and [L, 64] that are alike and each other's nearest."""
    if not len(first) or not len(second):
        return torch.zeros(0, dtype=torch.int64), torch.zeros(0, dtype=torch.int64)
    return mutual_best(first @ second.T, ALIKE)


def shortlist(views: Sequence[Features]) -> set[Pair]:
    """Each view with the views whose global descriptors are nearest: all pairs of few views."""
    described = global_descriptors(views)
    pairs = set()
    for i, one in enumerate(described):
        likeness = described @ one
        likeness[i] = -np.inf
        nearest = np.argsort(-likeness, kind="stable")[: min(SHORTLISTED, len(views) - 1)]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in nearest}
    return pairs


def global_descriptors(views: Sequence[Features]) -> NDArray[np.float32]:
    """VLAD of each view's strongest features, [N, WORDS x 64] of length 1, or 0 without features."""
    strongest = [view.strongest(COMPARED).descriptors for view in views]
    words = _vocabulary(np.concatenate(strongest))
    return np.stack([_vlad(one, words) for one in strongest])


def _vocabulary(descriptors: NDArray) -> NDArray[np.float32]:
    """Words [W, 64] of descriptors [K, 64]: spherical k-means of a sample."""
    random = generator(0, "vocabulary of features")
    sample = descriptors[random.permutation(len(descriptors))[: WORDS * SAMPLED]]
    words = sample[:WORDS]
    for _ in range(ROUNDS):
        nearest = (sample @ words.T).argmax(1) if len(sample) else np.zeros(0, int)
        sums = np.stack([sample[nearest == i].sum(0) for i in range(len(words))]) if len(words) else words
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        words = np.where(lengths > 0, sums / np.maximum(lengths, 1e-12), words)
    return words


def _vlad(descriptors: NDArray, words: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums of differences from the nearest words, each of length 1, then all of them together."""
    nearest = (descriptors @ words.T).argmax(1) if len(descriptors) else np.zeros(0, int)
    sums = np.zeros((WORDS, 64), np.float32)
    np.add.at(sums, nearest, descriptors - words[nearest])
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
    return np.asarray(sums.ravel() / max(float(np.linalg.norm(sums)), 1e-12), np.float32)
