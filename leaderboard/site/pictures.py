"""Small pictures of renders and of rainy and clean views, each written once, under a name made of its content."""

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from hashlib import sha256
from io import BytesIO
from pathlib import Path

from PIL import Image
from tqdm import tqdm

from baselines.training.images import evenly_spread
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import data_hash
from hydroviews.dataset.variants import has_clean, open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.formats.capture_json import CAPTURED
from leaderboard.records import SCORED, results_above
from leaderboard.runs.own_files import RENDERS
from leaderboard.site.runs import ShownRun

logger = logging.getLogger(__name__)

VIEWS = 3  # of a run
LONGEST = 640  # pixels
QUALITY, EFFORT = 85, 2
IMAGES = "images"  # of a variant
SMALL = ".webp"
VIEWS_FOLDER = "views"  # of a board: small pictures of what runs were given, by profile, scene and pattern
CLEAN_VIEW, RAINY_VIEW = "clean view", "rainy view"

Pictures = dict[str, dict[str, str]]  # file names by what is shown and view


@dataclass
class Thumbnails:
    """A folder of small pictures."""

    folder: Path
    written: set[str] = field(default_factory=set)  # their names, those found there too

    @cached_property
    def _there(self) -> set[str]:
        return {path.name for path in self.folder.glob(f"*{SMALL}")}

    def add(self, source: Path) -> str:
        """The name of the small picture of a picture, which is made unless it is there.

        Raises:
            OSError: it is none.
        """
        content = source.read_bytes()
        return self._keep(content, lambda: _small(content, source.suffix))

    def add_as(self, content: bytes, picture: Callable[[], Image.Image]) -> str:
        """The name of the small picture of some content; `picture` is what it looks like, asked for if need be."""
        return self._keep(content, lambda: _encoded(picture()))

    def _keep(self, content: bytes, small: Callable[[], bytes]) -> str:
        name = f"{sha256(content).hexdigest()[:20]}{SMALL}"
        if name not in self.written and name not in self._there:
            write_bytes(self.folder / name, small())
        self.written.add(name)
        return name


def small_copy(path: Path) -> bytes:
    """A picture as the pages show it, WebP of at most LONGEST pixels; one that is WebP stays as it is.

    Raises:
        OSError: it is no picture.
    """
    return _small(path.read_bytes(), path.suffix)


def _small(content: bytes, suffix: str) -> bytes:
    picture = _opened(content)
    return content if suffix == SMALL else _encoded(picture)


def _encoded(picture: Image.Image) -> bytes:
    picture.thumbnail((LONGEST, LONGEST))
    encoded = BytesIO()
    picture.save(encoded, "WEBP", quality=QUALITY, method=EFFORT)
    return encoded.getvalue()


def _opened(content: bytes) -> Image.Image:
    try:
        with Image.open(BytesIO(content)) as picture:
            return picture.convert("RGB")
    except (SyntaxError, ValueError) as error:  # as Pillow says of some damage
        raise OSError(f"no picture: {error}") from None


def scene_pictures(runs: Iterable[ShownRun], data: Path, thumbnails: Thumbnails) -> dict[str, Pictures]:
    """Pictures of one scene, profile and track by pattern and seed: rainy and clean views, and every method's renders.

    The renders of methods that learn from clean views stand under every pattern of their seed. A picture that cannot
    be had, such as a rainy view of data that are no longer there or have changed, is left out with a warning.

    Args:
        runs: of the scene.
        data: folder that the scenes were built in.
        thumbnails: take the small pictures.
    """
    scored = [run for run in runs if run.record["status"] in SCORED]
    references: dict[int, Pictures] = {}
    given: dict[tuple[str, int], Pictures] = {}
    renders: dict[tuple[str, int], Pictures] = {}
    for run in tqdm(scored, desc="pictures", unit="run", leave=False, disable=len(scored) < 20):
        pattern, seed = run.record["pattern"], run.record["seed"]
        shown = _renders(run, thumbnails)
        if not shown:
            continue
        if (pattern, seed) not in given:
            given[pattern, seed] = _given(run, data, list(shown), thumbnails)
        kept = references.setdefault(seed, {}) if pattern == CLEAN else renders.setdefault((pattern, seed), {})
        kept[run.name] = shown
    places = sorted(renders or given)  # where nothing was run on rainy views, the clean ones
    return {
        f"{pattern}, seed {seed}": given[pattern, seed] | references.get(seed, {}) | renders.get((pattern, seed), {})
        for pattern, seed in places
    }


def _renders(run: ShownRun, thumbnails: Thumbnails) -> dict[str, str]:
    return add_pictures({path.stem: path for path in chosen_renders(run.folder)}, thumbnails)


def chosen_renders(folder: Path) -> list[Path]:
    """The renders of a run that are shown: VIEWS of them, spread evenly over the held-out views."""
    paths = sorted(path for path in (folder / RENDERS).glob("*") if path.suffix in (".png", SMALL))
    return [paths[i] for i in evenly_spread(len(paths), VIEWS)]


def _given(run: ShownRun, data: Path, names: list[str], thumbnails: Thumbnails) -> Pictures:
    """What a run was given and is compared with, of some views, if these are still the data that it was run on."""
    profile, scene, pattern = (run.record[key] for key in ("profile", "scene", "pattern"))
    shipped = results_above(run.folder) / VIEWS_FOLDER / profile / scene
    patterns = {CLEAN_VIEW: CLEAN} | ({RAINY_VIEW: pattern} if pattern != CLEAN else {})
    try:
        if shipped.is_dir():
            paths = {title: _shipped_views(shipped / kind, names) for title, kind in patterns.items()}
        else:
            folder = built_scene(data, profile, scene, pattern, run.record["data_sha256"])
            paths = {title: view_paths(folder, images_of(folder, kind), names) for title, kind in patterns.items()}
        found = {title: add_pictures(files, thumbnails) for title, files in paths.items()}
    except InputError as error:
        logger.warning("no rainy or clean views of %s/%s on the pages: %s", scene, pattern, error)
        return {}
    return {title: shown for title, shown in found.items() if shown}


def _shipped_views(folder: Path, names: Iterable[str]) -> dict[str, Path]:
    paths = {name: folder / f"{name}{SMALL}" for name in names}
    return {name: path for name, path in paths.items() if path.is_file()}


def images_of(scene: Path, pattern: str) -> Path:
    """The folder of the pictures of a built scene's clean views, or of a variant."""
    return scene / CLEAN if pattern == CLEAN else scene / pattern / IMAGES


def built_scene(data: Path, profile: str, scene: str, pattern: str, data_sha256: str) -> Path:
    """The folder of the scene that a run with this hash was made on.

    Raises:
        InputError: there is none, or it holds other data by now.
    """
    folder = data / profile / scene
    if data_hash(folder.parent, folder.name, pattern) != data_sha256:
        raise InputError(f"{folder}: not the data that the runs under {pattern} were made on")
    return folder


def view_pictures(scene: Path, images: Path, views: Iterable[str], thumbnails: Thumbnails) -> dict[str, str]:
    """Small pictures of views of a built scene, by the views' names, from one of its folders of pictures.

    Raises:
        InputError: the scene cannot be read.
    """
    return add_pictures(view_paths(scene, images, views), thumbnails)


def view_paths(scene: Path, images: Path, views: Iterable[str]) -> dict[str, Path]:
    """The pictures of views of a built scene that there are in one of its folders of pictures, by the views' names.

    Raises:
        InputError: the scene cannot be read.
    """
    files = _view_files(scene)
    paths = {view: images / files[view] for view in views if view in files}
    return {view: path for view, path in paths.items() if path.is_file()}


@lru_cache(maxsize=4)
def _view_files(folder: Path) -> dict[str, Path]:
    """The pictures of a built scene's views by the views' names, as they are called in each folder of pictures."""
    own = has_clean(folder)
    root = folder / CLEAN if own else folder / CAPTURED / IMAGES
    scene = open_clean(folder) if own else open_variant(folder, CAPTURED)
    return {view.name: view.path.relative_to(root) for view in scene.views}


def add_pictures(paths: Mapping[str, Path], thumbnails: Thumbnails) -> dict[str, str]:
    """The names of the small pictures of some pictures, by view; one that is damaged is left out with a warning."""
    names = {}
    for view, path in paths.items():
        try:
            names[view] = thumbnails.add(path)
        except OSError as error:
            logger.warning("%s: not on the pages: %s", path, error)
    return names
