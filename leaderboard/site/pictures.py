"""Small pictures of renders, and of the rainy and clean views beside them, each written once under its content's name."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image
from tqdm import tqdm

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import data_hash
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from leaderboard.records import SCORED
from leaderboard.site.runs import ShownRun

logger = logging.getLogger(__name__)

VIEWS = 3  # of a run
LONGEST = 640  # pixels
QUALITY, EFFORT = 85, 2
CLEAN_VIEW, RAINY_VIEW = "clean view", "rainy view"

Pictures = dict[str, dict[str, str]]  # file names by what is shown and view


@dataclass
class Thumbnails:
    """A folder of small pictures."""

    folder: Path
    written: set[str] = field(default_factory=set)  # their names, those found there too

    @cached_property
    def _there(self) -> set[str]:
        return {path.name for path in self.folder.glob("*.webp")}

    def add(self, source: Path) -> str:
        """The name of the small picture of a picture, which is made unless it is there.

        Raises:
            OSError: it is none.
        """
        content = source.read_bytes()
        name = f"{sha256(content).hexdigest()[:20]}.webp"
        if name not in self.written and name not in self._there:
            with Image.open(BytesIO(content)) as picture:
                small = picture.convert("RGB")
            small.thumbnail((LONGEST, LONGEST))
            encoded = BytesIO()
            small.save(encoded, "WEBP", quality=QUALITY, method=EFFORT)
            write_bytes(self.folder / name, encoded.getvalue())
        self.written.add(name)
        return name


def scene_pictures(runs: Iterable[ShownRun], data: Path, thumbnails: Thumbnails) -> dict[str, Pictures]:
    """Pictures of one scene, profile and track by pattern and seed: every method's renders, rainy and clean views.

    The renders of methods that learn from clean views stand under every pattern of their seed. A picture that cannot
    be had, such as a rainy view of data that are no longer there or have changed, is left out with a warning.

    Args:
        runs: of the scene.
        data: folder that the scenes were built in.
        thumbnails: take the small pictures.
    """
    scored = [run for run in runs if run.record["status"] in SCORED]
    found: dict[str, Pictures] = {}
    for run in tqdm(scored, desc="pictures", unit="run", leave=False, disable=len(scored) < 20):
        renders = _renders(run, thumbnails)
        title = f"{run.record['pattern']}, seed {run.record['seed']}"
        if title not in found:
            found[title] = _given(run, data, list(renders), thumbnails)
        found[title][run.name] = renders
    for title in [title for title in found if title.startswith(f"{CLEAN},")]:
        others = [other for other in found if other.endswith(title.removeprefix(CLEAN)) and not other == title]
        for other in others:
            found[other] |= {name: shown for name, shown in found[title].items() if name not in found[other]}
        if others:
            del found[title]
    return found


def _renders(run: ShownRun, thumbnails: Thumbnails) -> dict[str, str]:
    paths = sorted((run.folder / "renders").glob("*.png"))
    chosen = [paths[i] for i in np.unique(np.linspace(0, len(paths) - 1, VIEWS).round().astype(int))] if paths else []
    return _added({path.stem: path for path in chosen}, thumbnails)


def _given(run: ShownRun, data: Path, names: list[str], thumbnails: Thumbnails) -> Pictures:
    """What a run was given and is compared with, of some views, if these are still the data that it was run on."""
    folder, pattern = data / run.record["profile"] / run.record["scene"], run.record["pattern"]
    found: Pictures = {}
    try:
        if data_hash(folder.parent, folder.name, pattern) != run.record["data_sha256"]:
            raise InputError(
                f"{folder}: not the data that the runs under {pattern} were made on", fix="build them anew"
            )
        openers = {CLEAN_VIEW: lambda: open_clean(folder)}
        openers |= {RAINY_VIEW: lambda: open_variant(folder, pattern)} if pattern != CLEAN else {}
        for title, opener in openers.items():
            paths = {view.name: view.path for view in opener().views if view.name in names and view.path.is_file()}
            found[title] = _added(paths, thumbnails)
    except InputError as error:
        logger.warning("no rainy or clean views of %s/%s on the pages: %s", folder.name, pattern, error)
    return {title: shown for title, shown in found.items() if shown}


def _added(paths: dict[str, Path], thumbnails: Thumbnails) -> dict[str, str]:
    names = {}
    for view, path in paths.items():
        try:
            names[view] = thumbnails.add(path)
        except OSError as error:
            logger.warning("%s: not on the pages: %s", path, error)
    return names
