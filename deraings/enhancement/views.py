"""The training photographs with their rain taken out, as photographs of one lens, each kept as a picture."""

import hashlib
import logging
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.training.images import TrainingImages
from baselines.training.torch_state import one_thread
from deraings.enhancement.clear_pixels import (
    DROPS,
    STREAKS,
    LensCovers,
    hidden_by_drops,
    lens_covers,
    with_clear_pixels,
)
from deraings.enhancement.enhance import predict, without_mist_on_lens
from deraings.enhancement.lenses import Lens, lenses_of_capture
from deraings.enhancement.weights import Enhancer
from deraings.image_planes import Plane, resized, within_side
from hydroviews.cli.threads import side_by_side
from hydroviews.scene.images import Image, read_image, to_uint8, write_png
from hydroviews.scene.masks import Ignored

logger = logging.getLogger(__name__)

BESIDE = 9  # pixels of the square around a hidden one in which nothing is told of rain
COVER_SIDE = 400  # pixels of the longer side, at most, of covers that are kept in memory


class EnhancedViews:
    """The photographs enhanced, each when it is first asked for, with what all of them say of their lens.

    Each is the work of one thread: the last bits of what torch adds up, and with them a training's end, depend on the
    number of threads.
    """

    def __init__(
        self,
        images: TrainingImages,
        names: Sequence[str],
        enhancer: Enhancer,
        folder: Path,
        remove_mist: bool = True,
    ) -> None:
        """Enhance nothing yet.

        Args:
            images: the training photographs.
            names: theirs, for the files.
            enhancer: the network.
            folder: where enhanced pictures are kept, apart for other photographs and other weights.
            remove_mist: whether mist is taken off first; not where it is foggy in the scene.
        """
        self._images, self._names, self._enhancer, self.remove_mist = images, names, enhancer, remove_mist
        self.digest = _fingerprint(images, enhancer, remove_mist)
        self._kept = folder / self.digest
        self._pictures: dict[bool, TrainingImages] = {}  # those read so far, clear or not

    def file(self, index: int) -> Path:
        """One picture as a PNG, written unless an earlier call has finished it; so is what rain covers of it."""
        path = self._kept / f"{self._names[index]}.png"
        if not path.is_file() or (self.tells_cover and not self._cover_file(index).is_file()):
            with one_thread():
                self._enhance(index, path)
        return path

    def _enhance(self, index: int, path: Path) -> None:
        photograph = self._photograph(index).astype(np.float32) / 255
        lens = self._lenses[index]
        enhanced = predict(photograph, self._enhancer, self.remove_mist, lens)
        if enhanced.cover is not None:
            write_png(self._cover_file(index), without_holes(enhanced.cover, self._images.ignored(index)))
        write_png(path, enhanced.picture)

    @property
    def tells_cover(self) -> bool:
        """Whether the network tells what rain covers."""
        return bool(self._enhancer.network.config.cover)

    def drop_cover(self, index: int) -> Plane:
        """How much of each pixel of a photograph drops cover [H, W], [0, 1], as far as the network tells from it.

        Raises:
            InputError: a kept picture is damaged.
        """
        return np.ascontiguousarray(self._rain_cover(index)[..., DROPS])

    def streak_cover(self, index: int) -> Plane:
        """The same of streaks."""
        return np.ascontiguousarray(self._rain_cover(index)[..., STREAKS])

    @property
    def drops_stay(self) -> bool:
        """Whether drops stay on the lens, as far as the network tells."""
        return self.tells_cover and self._lens_covers.stay

    def hidden_by_drops(self, index: int) -> Plane:
        """What drops that stay on the lens hide about the time of a photograph [h, w], [0, 1]; see `clear_pixels`.

        Raises:
            InputError: a kept picture is damaged.
        """
        return self._hidden[index]

    def mist_light(self) -> float | None:
        """Linear light that mist on the lens adds, the median over lens and photographs, as far as the network sees.

        None where it does not tell: it looks at single pictures only, or no photograph has others of its lens.
        """
        mists = [lens.mist.cpu().numpy() for lens in self._lenses if lens is not None and lens.mist is not None]
        return float(np.median([mist[0] * mist[1:].mean(axis=0) for mist in mists])) if mists else None

    def _photograph(self, index: int) -> NDArray[np.uint8]:
        """One photograph; what is hidden has the mean of what is shown: black would say that there is no mist."""
        pixels, hidden = self._images.pixels(index), self._images.ignored(index)
        if hidden is None or hidden.all():
            return pixels
        return np.where(hidden[..., None], pixels[~hidden].mean(axis=0).round(), pixels).astype(np.uint8)

    def _cover_file(self, index: int) -> Path:
        return self._kept / "cover" / f"{self._names[index]}.png"

    @cached_property
    def _lenses(self) -> list[Lens | None]:
        """What the photographs together say of the lens of each."""
        images = self._images
        with one_thread():
            return lenses_of_capture(len(images), self._photograph, self._enhancer.network, images.ignored)

    def image(self, index: int) -> Image:
        """One picture [H, W, 3].

        Raises:
            InputError: a kept picture is damaged.
        """
        return read_image(self.file(index))

    def training_images(self, clear: bool = False) -> TrainingImages:
        """All pictures, as training images that hide what the photographs hide; shows progress, read once.

        Args:
            clear: see `files`.

        Raises:
            InputError: a kept picture is damaged.
        """
        if clear not in self._pictures:
            pictures = [to_uint8(read_image(path)) for path in self.files(clear)]
            hidden = [self._images.ignored(index) for index in range(len(pictures))]
            self._pictures[clear] = TrainingImages(pictures, hidden)
        return self._pictures[clear]

    def files(self, clear: bool = False) -> list[Path]:
        """All pictures as PNG, in the order of the photographs, two at a time, showing progress.

        Args:
            clear: if drops stay on the lens, what lies between them is as the photographs show it: `clear_pixels`.

        Raises:
            InputError: a kept picture is damaged.
        """
        count, _ = len(self._images), self._lenses  # before several threads ask for them
        with one_thread():  # around all: each leaves behind the number of threads that it found
            paths = _of_all(self.file, count, "enhancing")
            if not (clear and self.drops_stay):
                return paths
            logger.info("drops stay on the lens: between drops, the scene is trained on the photographs")
            return _of_all(self._clear, count, "clear pixels")

    def _clear(self, index: int) -> Path:
        path = self._kept / "clear" / f"{self._names[index]}.png"
        if not path.is_file():
            photograph = self._photograph(index).astype(np.float32) / 255
            if self.remove_mist:
                photograph = without_mist_on_lens(photograph, self._enhancer.network, self._lenses[index])
            cover = resized(self._lens_covers.means[index], photograph.shape[:2])
            write_png(path, with_clear_pixels(self.image(index), photograph, cover))
        return path

    @cached_property
    def _lens_covers(self) -> LensCovers:
        self.files()  # together and with progress; below they would be enhanced one by one
        return lens_covers([self._cover(index) for index in range(len(self._images))])

    @cached_property
    def _hidden(self) -> list[Plane]:
        return [hidden_by_drops(mean) for mean in self._lens_covers.means]

    def _rain_cover(self, index: int) -> Image:
        """What streaks, drops and mist cover of each pixel of a photograph [H, W, 3], [0, 1]."""
        self.file(index)
        return read_image(self._cover_file(index))

    def _cover(self, index: int) -> NDArray[np.uint8]:
        """The same [h, w, 3], 255 for all, small enough to keep."""
        cover = self._rain_cover(index)
        return to_uint8(resized(cover, within_side(cover.shape[:2], COVER_SIDE)))


def without_holes(cover: Image, hidden: Ignored | None) -> Image:
    """A cover by rain [H, W, 3], set to 0 where a mask [H, W] hides a pixel and beside it: holes look like drops."""
    if hidden is None:
        return cover
    beside = cv2.dilate(hidden.astype(np.uint8), np.ones((BESIDE, BESIDE), np.uint8)) > 0
    return np.where(beside[..., None], np.float32(0), cover)


def _of_all(function: Callable[[int], Path], count: int, doing: str) -> list[Path]:
    """`function` of every index, two at a time, showing progress."""
    return list(tqdm(side_by_side(function, range(count)), desc=doing, unit="view", total=count, leave=False))


def _fingerprint(images: TrainingImages, enhancer: Enhancer, remove_mist: bool) -> str:
    digest = hashlib.sha256(images.digest().encode() + (b"" if remove_mist else b"with mist"))
    for name, value in enhancer.network.state_dict().items():
        digest.update(name.encode() + value.cpu().numpy().tobytes())
    return digest.hexdigest()[:16]
