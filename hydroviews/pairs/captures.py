"""Captures imitated with single photographs: parts of a few of them, in one light, as a camera on its way sees them."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.exposure import exposed
from hydroviews.pairs.photographs import Bytes, Frame

COMPANIONS = (0, 0, 1, 4, 4, 12, 12, 35)  # other pictures of a capture that networks learn with, by turns
SOURCES = (1, 2, 4, 35)  # photographs of which a capture has parts: one place, or places that have nothing in common
SMALLEST = 0.45  # of a photograph's sides that a part has
UNSTEADY = 0.1  # by how much exposures within a capture differ, at most


@dataclass(frozen=True, eq=False)
class Capture:
    """Photographs that companions are parts of, and their light."""

    sources: Sequence[Bytes]  # of any sizes
    mirrored: bool
    exposure: NDArray[np.float32]  # [3], factors on linear light

    def pictures(self, count: int, frame: Frame, size: Frame, rng: np.random.Generator) -> NDArray[np.uint8]:
        """So many pictures [count, H, W, 3] of a frame's shape, squeezed to `size`."""
        parts = [self._part(frame, size, rng) for _ in range(count)]
        return np.stack(parts) if parts else np.zeros((0, size[1], size[0], 3), np.uint8)

    def _part(self, frame: Frame, size: Frame, rng: np.random.Generator) -> Bytes:
        source = self.sources[rng.integers(len(self.sources))]
        scale = rng.uniform(SMALLEST, 1) * min(source.shape[1] / frame[0], source.shape[0] / frame[1])
        width, height = int(frame[0] * scale), int(frame[1] * scale)
        left, top = (int(rng.integers(most + 1)) for most in (source.shape[1] - width, source.shape[0] - height))
        part = np.ascontiguousarray(source[top : top + height, left : left + width])
        small = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA), np.uint8)
        small = small[:, ::-1] if self.mirrored else small
        return exposed(small, self.exposure * np.float32(rng.uniform(1 - UNSTEADY, 1)))
