"""Hard cases for camera estimation: few views, cameras that hardly move, changing lenses, photographs without detail.

    python -m benchmarks hard_poses --scene courtyard

Makes photographs of every case from a built scene, estimates their cameras and compares these with the true ones;
prints a table and writes hard_poses.csv. New camera paths are rendered from Gaussians that are trained on the clean
views. Finished cases are kept, an interrupted one resumes.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from baselines.gaussian_splatting import GaussianSplatting
from baselines.rendering.camera_paths import camera_path
from benchmarks.poses import measure
from benchmarks.quality import slug
from benchmarks.rain.hard_rain import behind, painted
from benchmarks.tables import finished, report
from deraings.enhancement.enhance import enhance
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.profiles import find_profile
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene, View

PATTERNS = ("raindrop-1", "streak-1", "window-2", "night-1")
N = 12  # views of a case, unless its name says otherwise
TURN = 3.0  # degrees between views of a pure rotation
ADVANCE = 0.03  # between views of a forward motion, in shares of the distance to what the cameras look at
SLOW = 300  # frames of a slow video around the whole path, of which a tenth is taken
WHITE, CONTRAST = 0.8, 0.15  # of white walls, encoded
ENLARGED = 5  # times
Views = tuple[View, ...]


def cases(built: Path, made: Path, seed: int) -> dict[str, Callable[[], Views]]:
    """Functions that make the photographs of each case of a built scene, by name; `made` gets painted photographs."""
    clean, drops = open_clean(built), open_variant(built, "raindrop-1")
    wet, falling = behind(built / "raindrop-1"), behind(built / "streak-1")

    def paint(name: str, views: Views, how: Callable[[View], Image] = wet) -> Views:
        return painted(replace(clean, views=views), made / slug(name), how).views

    def along(name: str, cameras: list[Camera]) -> Views:
        return paint(name, paint(f"{name} clean", moved(clean, cameras), rendered(clean, made / "training", seed)))

    first, views, dropped = clean.views[0].camera, clean.views[:N], drops.views[:N]
    distance = float(np.median(first.project(clean.points.positions)[1]))
    few = {f"{count} views": partial(tuple.__getitem__, drops.views, slice(count)) for count in (3, 6, 12)}
    return few | {
        "tripod": lambda: paint("tripod", tuple(replace(views[0], name=view.name) for view in views), falling),
        "pure rotation": lambda: along("rotation", [turned(first, i * TURN) for i in range(N)]),
        "forward motion": lambda: along("forward", [advanced(first, i * ADVANCE * distance) for i in range(N)]),
        "slow video": lambda: along("slow", slow_path(clean)),
        "night": lambda: open_variant(built, "night-1").views[:N],
        "white walls": lambda: paint("walls", paint("white", views, lambda view: WHITE + CONTRAST * view.image())),
        "drops on half of the lens": lambda: paint("half", views, partial(half, wet=wet)),
        "heavy window": lambda: open_variant(built, "window-2").views[:N],
        "lens wiped half-way": lambda: dropped[: N // 2] + views[N // 2 :],
        "portrait and landscape": lambda: paint("upright", dropped[::2], upright) + dropped[1::2],
        "1600 pixels": lambda: paint("large", dropped, enlarged),
        "one view without detail": lambda: paint("blank", dropped[:1], blank) + dropped[1:],
    }


def moved(scene: Scene, cameras: list[Camera]) -> Views:
    """Views with other cameras, under the names of the scene's first ones."""
    return tuple(replace(view, camera=camera) for view, camera in zip(scene.views, cameras, strict=False))


def rendered(scene: Scene, folder: Path, seed: int) -> Callable[[View], Image]:
    """A function that renders a view's camera from Gaussians of a scene, trained now or earlier in this folder."""
    method = GaussianSplatting(GaussianSplatting.configuration("demo"), seed)
    method.fit(scene, folder)
    return lambda view: method.render(view.camera)


def turned(camera: Camera, degrees: float) -> Camera:
    """The camera turned about its upright axis."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return replace(camera, world_to_camera=turn @ camera.world_to_camera)


def advanced(camera: Camera, distance: float) -> Camera:
    """The camera moved along its line of sight."""
    step = np.eye(4)
    step[2, 3] = -distance
    return replace(camera, world_to_camera=step @ camera.world_to_camera)


def slow_path(scene: Scene) -> list[Camera]:
    """The first tenth of a smooth path that takes `SLOW` frames around the scene."""
    return camera_path([view.camera for view in scene.train_views], scene.points, SLOW)[: SLOW // 10]


def half(view: View, wet: Callable[[View], Image]) -> Image:
    """A photograph through drops that lie on the left half of the lens alone."""
    image, middle = view.image().copy(), view.camera.width // 2
    image[:, :middle] = wet(view)[:, :middle]
    return image


def upright(view: View) -> Image:
    """The middle of a photograph as an upright one."""
    image = view.image()
    height, width = image.shape[:2]
    left = (width - height * height // width) // 2
    return image[:, left : width - left]


def enlarged(view: View) -> Image:
    """A photograph of `ENLARGED` times the width and height."""
    return np.clip(cv2.resize(view.image(), None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC), 0, 1)


def blank(view: View) -> Image:
    """A photograph of one grey."""
    return np.full_like(view.image(), WHITE)


def main(
    scene: str = "courtyard",
    only: tuple[str, ...] = (),
    data: Path = Path("data"),
    out: Path = Path("results/bench/hard_poses"),
    seed: int = 0,
) -> None:
    """Estimate the cameras of all cases and report.

    Args:
        scene: an embedded scene, a capture's name or its folder.
        only: estimate the cases whose names begin with one of these.
        data: where the built scene lies or goes.
        out: gets a folder for every scene and seed, with hard_poses.csv.
        seed: of the estimation and the training.
    """
    built = build_source(scene, data / "demo", find_profile("demo"), patterns=PATTERNS, all_patterns=False)
    folder = out / f"{built.name}-{seed}"

    def errors(name: str, opened: Callable[[], Views]) -> dict[str, Any]:
        found = measure(opened(), True, folder / f"{slug(name)} cameras", seed, enhance, "learned")
        return {key: found[key] for key in ("photographs", "registered", "pose_auc_10", "cpu_s")}

    chosen = [
        ({"case": name}, partial(errors, name, opened))
        for name, opened in cases(built, folder, seed).items()
        if not only or name.startswith(only)
    ]
    csv = folder / "hard_poses.csv"
    report(finished(csv, chosen), csv)
