"""Where drops sit on the lens, for captures that were taken through drops and say so.

A capture may have them as DerainNeRF does, `rainMask.npy` with a plane for every photograph, or as pictures
`rain_masks/<image file name>.png`, bright where a drop is. A built scene has them as `captured-0/drops/<view>.png`,
white where a drop is, at the built size. They are for methods that ask for them: unlike `masks`, which hide pixels
from everyone, they change neither training nor scoring by themselves.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.dataset.manifest import read_manifest, record_files
from hydroviews.errors import InputError
from hydroviews.files.known_bytes import require_bytes
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.photographs import photographs_below
from hydroviews.scene.images import write_png
from hydroviews.scene.masks import find_mask, read_grey
from hydroviews.scene.scenes import Scene, View

ARRAY, PICTURES = "rainMask.npy", "rain_masks"
BUILT = "drops"

Drops = NDArray[np.bool_]  # [H, W], True where a drop is


def write_drop_masks(scene: Scene, built: Path, views: Sequence[View]) -> None:
    """Write the drop masks of a capture, if it has any, beside its photographs in the built scene.

    Args:
        scene: the capture.
        built: the built scene's folder, which the manifest beside it lists.
        views: the capture's own, but the clean ones beside rainy ones, at the built size.

    Raises:
        InputError: masks for other photographs, or unreadable ones; or one is not what the manifest says.
    """
    masks = _DropMasks([view.path for view in scene.own_views])
    if not masks.folder:
        return
    names = {view.name: f"{CAPTURED}/{BUILT}/{view.name}.png" for view in views}
    for view in tqdm(views, desc=f"{scene.name}: drop masks", unit="view", leave=False):
        path = built / names[view.name]
        drops = None if path.is_file() else masks.read(view)
        if drops is not None:
            write_png(path, np.repeat(drops[..., None], 3, axis=2).astype(np.uint8) * 255)
    listed = read_manifest(built.parent)["scenes"][built.name]["files"]
    new = [name for name in names.values() if (built / name).is_file() and name not in listed]
    if new:
        record_files(built.parent, built.name, new)
    for name in set(names.values()) & set(listed):
        require_bytes(built / name, listed[name])


class _DropMasks:
    """The drop masks of a capture; `folder` is None where it has none."""

    def __init__(self, photographs: Sequence[Path]) -> None:
        above = list(photographs[0].parents)[:3]
        self.folder = next((f for f in above if (f / ARRAY).is_file() or (f / PICTURES).is_dir()), None)
        self._array = _read_array(self.folder / ARRAY) if self.folder and (self.folder / ARRAY).is_file() else None
        if self.folder is None or self._array is None:
            return
        images = self.folder / photographs[0].relative_to(self.folder).parts[0]
        self._files = photographs_below(images)
        if self._array.shape[2] != len(self._files):
            raise InputError(
                f"{self.folder}/{ARRAY}: masks for other photographs",
                found=f"{self._array.shape[2]} masks, {len(self._files)} photographs in {images}",
                expected="one a photograph, in the order of their names",
            )

    def read(self, view: View) -> Drops | None:
        """The mask of a view's photograph, undistorted and resized like its picture."""
        assert self.folder is not None
        if self._array is not None:
            drops, origin = _is_drop(self._array[:, :, self._files.index(view.path)]), self.folder / ARRAY
        else:
            found = find_mask(self.folder / PICTURES, view.path.name)
            if found is None:
                return None
            drops, origin = np.asarray(read_grey(found) > 127), found
        return view.fit_mask(drops, origin)


def _read_array(path: Path) -> NDArray:
    """[H, W, N], not read into memory as a whole."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError, OverflowError, SyntaxError) as error:
        raise InputError(f"{path}: not a NumPy array", found=error, fix="copy the file again") from error
    if array.ndim != 3 or array.dtype.kind not in "bufi":
        raise InputError(
            f"{path}: not an array of masks",
            found=f"{array.dtype} of shape {array.shape}",
            expected="numbers of shape [height, width, photographs]",
        )
    return array


def _is_drop(plane: NDArray) -> Drops:
    """Masks are kept as truth, as 0 to 1 or as 0 to 255."""
    return np.asarray(plane > (127 if plane.max() > 1 else 0.5))
