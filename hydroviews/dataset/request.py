"""What a scene was asked to be: kept beside it, so that another request for the same folder is refused."""

import hashlib
import json
import logging
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hydroviews.dataset.drawing_code import VERSION, drawing_code
from hydroviews.dataset.manifest import forget_scene, read_manifest
from hydroviews.errors import InputError
from hydroviews.files.atomic import is_there, read_json, sha256
from hydroviews.files.settings_guard import claim_folder
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect, parse_pattern
from hydroviews.rain.scene_statistics import LensRenderer
from hydroviews.scene.depth import depth_path
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

UNCOMPRESSED = (".bmp", ".tif", ".tiff")
GLIMPSE = 65536  # bytes
WHOLE = "this scene"
REQUEST = "request.json"
CODE = {"generator", "drawing_code"}  # of a request: what drew it


@dataclass(frozen=True)
class BuildRequest:
    """What fixes the pixels of a built scene, beside the patterns."""

    source: str  # the name or folder it was built from, for people
    capture: str  # fingerprint of the capture's cameras
    long_side: int | None
    seed: int
    lens_renderer: LensRenderer  # of water on the lens
    generator: str  # version of the package that draws, for people
    drawing_code: str  # digest of the sources that draw


def make_request(
    scene: Scene, source: str, long_side: int | None, seed: int, lens_renderer: LensRenderer
) -> BuildRequest:
    """The request for a capture at its own size."""
    capture = _fingerprint(scene)
    return BuildRequest(source or scene.name, capture, long_side, seed, lens_renderer, VERSION, drawing_code())


def take_folder(out: Path, folder: Path, request: BuildRequest, overwrite: bool) -> None:
    """Take the folder for this request; what another request left there is refused, or dropped to overwrite it.

    What other code drew of the same request is dropped to overwrite it, and else left to `drawn_otherwise`; what an
    older generator did not yet record is not compared. What was begun of a capture that has changed since is dropped:
    a capture can be mended until its scene is finished.

    Raises:
        InputError: another request's scene is there, or files that no build wrote.
    """
    path = folder / REQUEST
    earlier = read_json(path) if not overwrite and is_there(path) else {}
    earlier = earlier if isinstance(earlier, dict) else {}
    unknown = set(vars(request)) - set(earlier) if earlier else set()
    mended = _only_capture_differs(earlier, request) and folder.name not in read_manifest(out)["scenes"]
    if mended:
        logger.info("%s: %s has changed, so that what was begun of it is made anew", folder, request.source)
    claim_folder(
        path,
        vars(request),
        taken="this scene was built from another request" + _other_source(earlier, request),
        foreign="holds files that no build wrote",
        fix="choose another --out, or add --overwrite to build it anew",
        ignored=("source", "generator") if overwrite else ("source", *CODE, *unknown),
        overwrite=overwrite or mended,
        forget=lambda: forget_scene(out, folder.name),
    )


def _only_capture_differs(earlier: Mapping[str, Any], request: BuildRequest) -> bool:
    """Whether a request wants what an earlier one did of the same source, which has changed."""
    others = {name for name, value in vars(request).items() if earlier.get(name) != value}
    return "capture" in others and others <= {"capture", *CODE}


def _other_source(earlier: Mapping[str, Any], request: BuildRequest) -> str:
    """Both captures where they have different ones, as the end of a sentence; two folders may have one name."""
    if earlier.get("capture") == request.capture:
        return ""
    if earlier.get("source") == request.source:
        return f": {request.source} has changed: photographs, cameras, masks, depth, points, split or capture.json"
    return f": of {earlier.get('source')}, another capture than {request.source}"


def drawn_otherwise(folder: Path, patterns: Collection[str]) -> list[str]:
    """What of a built scene was drawn by other code than today's: names of variants, or WHOLE for all of it.

    Args:
        folder: of the built scene.
        patterns: names of its variants; one that has lost its `pattern.json` is passed over.

    Raises:
        InputError: an effect of one's own that is no more.
    """
    if _recorded_code(folder / REQUEST) != drawing_code():
        return [WHOLE]
    kept = [name for name in patterns if (folder / name / PATTERN_FILE).is_file()]
    return [
        name
        for name in kept
        if _recorded_code(folder / name / PATTERN_FILE) != drawing_code(find_effect(parse_pattern(name).effect))
    ]


def _recorded_code(path: Path) -> str | None:
    facts = read_json(path)
    return facts.get("drawing_code") if isinstance(facts, dict) else None


def refuse_own_capture(scene: Scene, folder: Path) -> None:
    """A build must not write into the capture that it reads."""
    target = folder.resolve()
    inside = [view.path for view in scene.views if target in view.path.resolve().parents]
    if inside:
        raise InputError(
            f"{folder}: the capture itself would be overwritten by what is built from it",
            found=f"its images, such as {inside[0]}",
            fix="choose another --out, outside the folder that holds the capture",
        )


def _fingerprint(scene: Scene) -> str:
    """Changes when the capture's views, cameras, lenses, points, split, image files or what it says of itself do."""
    digest = hashlib.sha256(json.dumps(asdict(scene.split)).encode())
    digest.update(np.ascontiguousarray(scene.points.positions, np.float64).round(9).tobytes())
    digest.update(np.ascontiguousarray(scene.points.colours).tobytes())
    for view in scene.views:
        camera = view.camera
        pose = [round(x, 9) for x in camera.world_to_camera.ravel().tolist()]
        facts = [view.name, camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, pose]
        digest.update(json.dumps(facts).encode() + _glimpse(view.path))
        digest.update(repr((view.lens.model, view.lens.params)).encode() if view.lens else b"")
        digest.update(_glimpse(view.mask) if view.mask else b"")
        digest.update(_glimpse(depth_path(view)))
    for view in scene.clean_views:
        digest.update(view.name.encode() + _glimpse(view.path))
    said = [scene.captured_rainy, scene.metres_per_unit, scene.clean_error, scene.drops_cost]
    digest.update(json.dumps(said).encode())
    return digest.hexdigest()[:16]


def _glimpse(path: Path) -> bytes:
    """Size, beginning and end of a file: enough to see that it is another one, cheap for large captures.

    Where pictures are not compressed all of it, since a change in the middle leaves size and ends.
    """
    if not path.is_file():
        return b"missing"
    if path.suffix.lower() in UNCOMPRESSED:
        return sha256(path).encode()
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(GLIMPSE)
        file.seek(max(0, size - GLIMPSE))
        return str(size).encode() + start + file.read()
