"""The training photographs with their rain taken out, as photographs of one lens, each kept as a picture."""

import hashlib
import logging
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.training.images import TrainingImages, evenly_spread
from baselines.training.torch_state import one_thread
from deraings.enhancement.architecture.lenses import Lens
from deraings.enhancement.clear_pixels import (
    DROPS,
    LensCovers,
    hidden_by_drops,
    lens_covers,
    with_clear_pixels,
)
from deraings.enhancement.companions import lenses_of_companions, without_holes
from deraings.enhancement.enhance import predict, without_mist_on_lens
from deraings.enhancement.weights import Enhancer
from deraings.image_planes import Plane, resized, within_side
from deraings.lens.mist_prior import NetworkMist
from hydroviews.cli.threads import side_by_side
from hydroviews.scene.images import Image, read_image, to_uint8, write_png

logger = logging.getLogger(__name__)

COVER_SIDE = 400  # pixels of the longer side, at most, of covers that are kept in memory
LOOKED_AT = 20  # photographs, spread evenly, that show whether there is rain
# Mean share of the network's change that is not its own error, from which there is rain to remove. Development scenes:
# 0.01 dry and 0.05 in fog, 0.45 and more in rain of any grade and either generator.
LEAST_CHANGE = 0.1


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
        self._errors: dict[int, NDArray[np.uint8]] = {}  # roots of expected errors that were read so far

    def file(self, index: int) -> Path:
        """One picture as a PNG, written unless an earlier call has finished it; so is what rain covers of it."""
        path = self._kept / f"{self._names[index]}.png"
        if not self._finished(index, path):
            with one_thread():
                self._enhance(index, path)
        return path

    def _enhance(self, index: int, path: Path) -> None:
        photograph = self._photograph(index).astype(np.float32) / 255
        lens = self._lenses[index]
        enhanced = predict(photograph, self._enhancer, self.remove_mist, lens)
        if enhanced.cover is not None:
            write_png(self._cover_file(index), without_holes(enhanced.cover, self._images.ignored(index)))
        if enhanced.error is not None:
            write_png(self._error_file(index), np.repeat(np.sqrt(enhanced.error)[..., None], 3, axis=2))
        write_png(path, enhanced.picture)

    @property
    def tells_cover(self) -> bool:
        """Whether the network tells what rain covers."""
        return bool(self._enhancer.network.config.cover)

    def small_drop_cover(self, index: int) -> Plane:
        """How much of each pixel of a photograph drops cover [h, w], [0, 1], as the network predicts from it.

        Raises:
            InputError: a kept picture is damaged.
        """
        return np.multiply(self._small_covers[index][..., DROPS], np.float32(1 / 255), dtype=np.float32)

    def mean_drop_cover(self, index: int) -> Plane:
        """The mean of the same over the other photographs about the time of one [h, w], unless its drops are new."""
        return self._lens_covers.means[index]

    @property
    def wet(self) -> bool:
        """True if the network predicts drops on the lens."""
        return self.tells_cover and self._lens_covers.wet

    def hidden_by_drops(self, index: int) -> Plane:
        """The share of each pixel [h, w] that drops hide about the time of a photograph, [0, 1]; see `clear_pixels`.

        Raises:
            InputError: a kept picture is damaged.
        """
        return self._hidden[index]

    def without_mist(self, index: int) -> Image:
        """A photograph [H, W, 3] without its mist, and nothing else done to it: not clipped."""
        photograph = self._photograph(index).astype(np.float32) / 255
        if not self.remove_mist:
            return photograph
        with one_thread():
            return without_mist_on_lens(photograph, self._enhancer.network, self._lenses[index])

    def lens_mist(self, index: int) -> NetworkMist | None:
        """The mist that the network predicts on the lens of a photograph.

        None where it predicts none: it looks at single pictures only, or no photograph has others of its lens.
        """
        lens = self._lenses[index]
        if lens is None or lens.mist is None or lens.mist_error is None:
            return None
        mist = lens.mist.cpu().numpy()
        return NetworkMist(mist[0] * mist[1:].mean(axis=0), lens.mist_error.cpu().numpy())

    def _photograph(self, index: int) -> NDArray[np.uint8]:
        """One photograph; what is hidden has the mean of what is shown: black would say that there is no mist."""
        pixels, hidden = self._images.pixels(index), self._images.ignored(index)
        if hidden is None or hidden.all():
            return pixels
        return np.where(hidden[..., None], pixels[~hidden].mean(axis=0).round(), pixels).astype(np.uint8)

    @cached_property
    def finds_rain(self) -> bool:
        """True if the network finds rain to remove. In dry photographs and in fog, its changes are its own errors.

        Raises:
            InputError: a kept picture is damaged.
        """
        self.files()  # together and with progress
        chosen = evenly_spread(len(self._images), LOOKED_AT)
        return bool(np.mean([self.change_over_error(index) for index in chosen]) >= LEAST_CHANGE)

    def change_over_error(self, index: int) -> float:
        """The share of what the network changes in a photograph that is not to be expected as its own error, [0, 1].

        (I - E)^2 / ((I - E)^2 + s^2), of sums over the shown pixels, with the photograph I, its enhancement E and the
        error s that the network expects; 1 if it expects none.

        Raises:
            InputError: a kept picture is damaged.
        """
        hidden = self._images.ignored(index)
        shown = np.ones(self._images.pixels(index).shape[:2], np.bool_) if hidden is None else ~hidden
        pictures, photograph = self._pictures.get(False), self._images.pixels(index)
        enhanced = to_uint8(self.image(index)) if pictures is None else pictures.pixels(index)
        change = (enhanced.astype(np.float32) - photograph).mean(axis=2) / 255
        error = self.small_error(index)
        power = float(np.square(change[shown]).sum())
        noise = 0.0 if error is None else float(np.square(resized(error, shown.shape)[shown]).sum())
        return power / (power + noise) if power > 0 else 0.0

    def small_error(self, index: int) -> Plane | None:
        """The mean absolute error of an enhanced picture that the network expects [h, w]; None if it expects none.

        Raises:
            InputError: a kept picture is damaged.
        """
        if not self._enhancer.network.config.error:
            return None
        if index not in self._errors:
            self.file(index)
            error = read_image(self._error_file(index))[..., 0]
            self._errors[index] = to_uint8(resized(error, within_side(error.shape, COVER_SIDE)))
        return np.square(self._errors[index].astype(np.float32) / 255)

    def _cover_file(self, index: int) -> Path:
        return self._kept / "cover" / f"{self._names[index]}.png"

    def _error_file(self, index: int) -> Path:
        return self._kept / "error" / f"{self._names[index]}.png"

    def _finished(self, index: int, path: Path) -> bool:
        """Whether a picture and all that the network predicts beside it have been written."""
        config = self._enhancer.network.config
        beside = [(config.cover, self._cover_file(index)), (config.error, self._error_file(index))]
        return path.is_file() and all(file.is_file() for predicted, file in beside if predicted)

    @cached_property
    def _lenses(self) -> list[Lens | None]:
        """What the photographs together say of the lens of each."""
        images = self._images
        with one_thread():
            return lenses_of_companions(len(images), self._photograph, self._enhancer, images.ignored)

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
            clear: if drops are on the lens, what lies between them is as the photographs show it: `clear_pixels`.

        Raises:
            InputError: a kept picture is damaged.
        """
        count, _ = len(self._images), self._lenses  # before several threads ask for them
        with one_thread():  # around all: each leaves behind the number of threads that it found
            paths = _of_all(self.file, count, "enhancing")
            if not (clear and self.wet):
                return paths
            logger.info("drops are on the lens: between drops, the scene is trained on the photographs")
            return _of_all(self._clear, count, "clear pixels")

    def _clear(self, index: int) -> Path:
        path = self._kept / "clear" / f"{self._names[index]}.png"
        if not path.is_file():
            photograph = self.without_mist(index)
            cover = resized(self._lens_covers.means[index], photograph.shape[:2])
            write_png(path, with_clear_pixels(self.image(index), photograph, cover))
        return path

    @cached_property
    def _lens_covers(self) -> LensCovers:
        new = [lens is not None and lens.fine is None for lens in self._lenses]
        return lens_covers(self._small_covers, new)

    @cached_property
    def _small_covers(self) -> list[NDArray[np.uint8]]:
        self.files()  # together and with progress; below they would be enhanced one by one
        return [self._cover(index) for index in range(len(self._images))]

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


def _of_all(function: Callable[[int], Path], count: int, doing: str) -> list[Path]:
    """`function` of every index, two at a time, showing progress."""
    return list(tqdm(side_by_side(function, range(count)), desc=doing, unit="view", total=count, leave=False))


def _fingerprint(images: TrainingImages, enhancer: Enhancer, remove_mist: bool) -> str:
    digest = hashlib.sha256(images.digest().encode() + (b"" if remove_mist else b"with mist"))
    for name, value in enhancer.network.state_dict().items():
        digest.update(name.encode() + value.cpu().numpy().tobytes())
    return digest.hexdigest()[:16]
