"""A built or packed variant as a PyTorch data set: pairs of rainy and clean views, for people who train networks.

views = RainyViews(Path("data/demo/courtyard"), "raindrop-1")
views = RainyViews(Path("courtyard-raindrop-1.zip"))    # read where it lies, nothing is unpacked
loader = torch.utils.data.DataLoader(views, batch_size=4, num_workers=2)
"""

import logging
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import known_file, scene_entry
from hydroviews.dataset.sharing.archive import open_archive
from hydroviews.dataset.sharing.contents import IMAGES, LAYERS, variants_of
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import read_json
from hydroviews.formats.colmap_format import read_cameras, read_images
from hydroviews.formats.photographs import SPLIT, read_split
from hydroviews.formats.writers import MODEL
from hydroviews.rain.effect import Effect
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import read_image

logger = logging.getLogger(__name__)

Part = Literal["train", "test"]


class Files(Protocol):
    """Where the files of a scene are."""

    def file(self, name: str) -> AbstractContextManager[Path]:
        """A file of the scene, compared with its manifest; on disk until the block ends."""
        ...


@dataclass(frozen=True)
class _Built:
    """The files of a built scene."""

    folder: Path

    @contextmanager
    def file(self, name: str) -> Iterator[Path]:
        yield known_file(self.folder, name)


class RainyViews(torch.utils.data.Dataset):
    """The training or held-out views of one variant, in order of their names.

    An item is a dict of float32 tensors, ready for the default collation of a DataLoader:

    | key | shape | is |
    |---|---|---|
    | name | | the view's name, a str |
    | rainy, clean | [3, H, W] | sRGB-encoded, [0, 1] |
    | layers | a dict of [H, W] | what rain added, by plane of its effect; M, V, S are covers, R, G, B linear light |
    | cover | [1, H, W] | share of the background that rain hides, [0, 1]: the union of all covers |
    | intrinsics | [3, 3] | pinhole camera in pixels, pixel centres at +0.5 |
    | world_to_camera | [4, 4] | rigid, OpenCV axes |

    What a variant does not have is not in its items: the clean scene has no rain, a capture taken in rain no clean
    views and layers. Without the package of an effect that is not HydroViews' own there is no cover; a warning
    says so. Files are compared with the manifest when they are read. Copies for workers hold nothing open.

    Args:
        source: a built scene's folder, or an archive that `hydroviews pack` wrote.
        variant: a pattern's name, such as raindrop-1; that of the archive if None.
        split: "train" or "test".

    Raises:
        InputError: no such scene, variant or split; a file is missing or not what the manifest says; or the archive
            holds no pictures.
    """

    def __init__(self, source: Path | str, variant: str | None = None, split: Part = "train"):
        source = Path(source)
        packed = open_archive(source) if source.is_file() else None
        self._files: Files = packed or _Built(source)
        entry = packed.entry if packed else scene_entry(source)
        if entry is None:
            raise InputError(f"{source}: no finished scene", fix="build it first, or name an archive")
        there = variants_of(entry)
        self.variant = variant or (there[-1] if packed else "")  # of an archive: after its clean views
        if self.variant not in there:
            raise unknown_name(f"variant {variant}", self.variant, f"variant of {source}", there)
        if split not in ("train", "test"):
            raise unknown_name(f"split {split}", split, "split", ("train", "test"))
        self._listed = frozenset(entry["files"]) - (packed.left_out if packed else frozenset())
        pictures = CLEAN if self.variant == CLEAN else f"{self.variant}/{IMAGES}"
        if not any(name.startswith(f"{pictures}/") for name in self._listed):
            raise InputError(f"{source}: no pictures of {self.variant} in it", fix="fetch it into a built scene")
        self._effect = self._find_effect() if f"{self.variant}/{PATTERN_FILE}" in self._listed else None
        self._cameras, names = _cameras(self._files, self._listed, split)
        self.names = tuple(name for name in names if f"{pictures}/{name}.png" in self._listed)

    def __len__(self) -> int:
        return len(self.names)

    def _find_effect(self) -> Effect | None:
        with self._files.file(f"{self.variant}/{PATTERN_FILE}") as path:
            name = read_json(path)["effect"]
        try:
            return find_effect(name)
        except InputError as error:
            logger.warning("%s: items have no cover: %s", self.variant, error)
            return None

    def __getitem__(self, index: int) -> dict[str, Any]:
        name = self.names[index]
        camera = self._cameras[name]
        item = {"name": name, "intrinsics": camera.matrix, "world_to_camera": camera.world_to_camera}
        clean, rainy = f"{CLEAN}/{name}.png", f"{self.variant}/{IMAGES}/{name}.png"
        layers = f"{self.variant}/{LAYERS}/{name}.exr"
        for key, file in (("clean", clean), ("rainy", rainy)):
            if file in self._listed:
                with self._files.file(file) as path:
                    item[key] = read_image(path).transpose(2, 0, 1)
        if layers in self._listed:
            with self._files.file(layers) as path:
                planes = read_layers(path)
            item["layers"] = {key: _tensor(plane) for key, plane in planes.items()}
            if self._effect is not None:
                item["cover"] = _cover(self._effect, planes)
        return {key: _tensor(value) if isinstance(value, np.ndarray) else value for key, value in item.items()}


def _cameras(files: Files, listed: frozenset[str], split: Part) -> tuple[dict[str, Camera], tuple[str, ...]]:
    """Cameras by view, and the names of the views of a split."""
    model = [name for name in listed if name.startswith(f"{MODEL.as_posix()}/")]
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as folder:
        for name in (*model, SPLIT):
            target = Path(folder, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            with files.file(name) as path:
                target.write_bytes(path.read_bytes())
        lenses, names = read_cameras(Path(folder, MODEL)), read_split(Path(folder))
        images = read_images(Path(folder, MODEL))
    cameras = {}
    for image in images:
        lens = lenses[image.camera_id]
        cameras[Path(image.name).stem] = lens.pinhole((lens.width, lens.height)).camera(image.world_to_camera)
    return cameras, tuple(sorted(getattr(names, split)))


def _cover(effect: Effect, planes: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """Share of the background that rain hides, [1, H, W]."""
    passing = np.ones_like(next(iter(planes.values())))
    for cover in effect.covers(planes).values():
        passing = passing * (1 - np.clip(cover, 0, 1))
    return (1 - passing)[None]


def _tensor(array: NDArray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float32))
