"""A rainy video of an embedded scene along a smooth camera path: streaks fall, and drops stay on the lens.

    python -m examples.rainy_clip sample.mp4

This script made the clip that `hydroviews download sample` copies. Blender renders a frame in about six seconds on one
core. If you interrupt the command, repeat it.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from baselines.rendering.film import write_film
from hydroviews.blender.embedded_scenes.captures import VERSION, read_embedded
from hydroviews.blender.process import run_blender
from hydroviews.files.atomic import write_json
from hydroviews.rain.effect import fall
from hydroviews.rain.registry import find_effect, parse_pattern
from hydroviews.rain.scene_statistics import survey
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, write_png
from hydroviews.scene.scenes import Scene

SCENE, SEED = "courtyard", 0
RAIN = ("streak-1", "raindrop-1")  # in the order of the light's way
FRAMES, FPS = 24, 1
WIDTH, HEIGHT, FOCAL = 320, 240, 230.4  # pixels
FIRST, STEP = np.radians(20.0), np.radians(7.5)  # around the courtyard
TARGET = np.array([0, 0, 1.15])  # metres; what all cameras look at


def camera(angle: float) -> Camera:
    """A camera on a slightly wavy ring around the target, at an angle in radians."""
    radius, height = 7.1 + 0.25 * np.sin(2 * angle), 2.0 + 0.24 * np.sin(3 * angle)
    eye = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    forward = (TARGET - eye) / np.linalg.norm(TARGET - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = [right, np.cross(forward, right), forward]
    pose[:3, 3] = -pose[:3, :3] @ eye
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose)


def render(folder: Path) -> Scene:
    """The clean frames as a capture; frames that are there already are kept."""
    cameras = {f"{i:03d}": camera(FIRST + i * STEP) for i in range(FRAMES)}
    records = {name: asdict(one) | {"world_to_camera": one.world_to_camera.tolist()} for name, one in cameras.items()}
    views = [{"name": name, **record} for name, record in records.items()]
    task = {"scene": SCENE, "folder": str(folder), "seed": SEED, "views": views}
    run_blender("render_views", task, folder / "blender.log", SCENE)
    write_json(folder / "cameras.json", {"request": {"version": VERSION}, "metres_per_unit": 1.0, "views": views})
    return read_embedded(SCENE, folder)


def rainy_frames(scene: Scene, patterns: Sequence[str], seed: int, work: Path) -> Iterator[Image]:
    """The views of a scene in rain, in order: float32 [H, W, 3], sRGB-encoded, [0, 1].

    Args:
        scene: clean views of one size.
        patterns: effects with a grade; each effect works on the output of the one before.
        seed: of the rain.
        work: folder for what effects prepare once.
    """
    statistics = survey(scene, seed)
    rains = []
    for pattern in map(parse_pattern, patterns):
        effect = find_effect(pattern.effect)
        rain = effect.place(effect.draw(pattern, statistics), pattern, statistics)
        rains.append((effect, rain, rain.prepare(scene.views[0].camera, work / pattern.name)))
    for view in scene.views:
        image = view.image()
        for effect, rain, ready in rains:
            image = effect.composite(rain.parameters, image, fall(ready, image, view))
        yield image


def main(out: Path) -> None:
    """Write the clip, and its frames into a folder beside it."""
    work = out.with_suffix("")
    for i, image in enumerate(rainy_frames(render(work / "clean"), RAIN, SEED, work)):
        write_png(work / "rainy" / f"{i:05d}.png", image)
    write_film(out, work / "rainy", FRAMES, FPS)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
