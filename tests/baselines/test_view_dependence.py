"""The chosen spherical-harmonic degree on scenes whose view dependence is known."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from baselines.splatting import view_dependence as module
from baselines.splatting.reference import basis
from baselines.splatting.view_dependence import FEWEST_VIEWS, choose_sh_degree, sample_views
from hydroviews.cameras import Camera
from hydroviews.depth import write_depth
from hydroviews.errors import InputError
from hydroviews.images import write_png
from hydroviews.masks import write_ignored
from hydroviews.scenes import Points, Scene, View, make_scene, no_points

WIDTH, HEIGHT = 96, 72
VIEWS = 40


def spiral(n: int) -> np.ndarray:
    """Points [n, 3] spread evenly over the unit sphere."""
    height = 1 - (2 * np.arange(n) + 1) / n
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    ring = np.sqrt(1 - height**2)
    return np.stack([ring * np.cos(angle), height, ring * np.sin(angle)], axis=1)


def looking_inwards(centre: np.ndarray) -> Camera:
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, [0.1, -1.0, 0.2])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ centre
    return Camera(WIDTH, HEIGHT, 90.0, 90.0, WIDTH / 2, HEIGHT / 2, pose)


def surface(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the unit sphere is hit [H W, 3], where it is not, and z [H W], infinite there."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=2).reshape(-1, 3)
    world, eye = rays @ camera.rotation, camera.centre
    a, b, c = (world**2).sum(1), world @ eye, eye @ eye - 1
    missed = b * b < a * c
    depth = (-b - np.sqrt(np.where(missed, 0, b * b - a * c))) / a
    return eye + depth[:, None] * world, missed, np.where(missed, np.inf, depth)


class Ball:
    """A ball of fine texture whose gloss is of one spherical-harmonic degree, and the same all over it."""

    def __init__(self, gloss: int, strength: float = 0.12):
        generator = np.random.default_rng(gloss)
        self.waves = 9 * generator.normal(size=(3, 6))
        self.shares = 0.1 * generator.normal(size=(6, 3))
        self.gloss, self.sh = gloss, np.zeros(((gloss + 1) ** 2, 3))
        if gloss > 0:
            self.sh[gloss**2 :] = strength * generator.normal(size=(2 * gloss + 1, 3)) / np.sqrt(gloss)

    def colours(self, positions: np.ndarray, eye: np.ndarray) -> np.ndarray:
        directions = positions - eye
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        shading = basis(self.gloss, torch.from_numpy(directions)).numpy() @ self.sh
        return 0.5 + np.sin(positions @ self.waves) @ self.shares + shading


def photographed(folder: Path, ball: Ball, noise: float = 0.03, depths: bool = True, n_views: int = VIEWS) -> Scene:
    """The ball before a grey wall at infinity, with points on all of it."""
    generator, views = np.random.default_rng(0), []
    for number, centre in enumerate(3.0 * spiral(n_views)):
        view = View(f"{number:03d}", looking_inwards(centre), folder / "clean" / f"{number:03d}.png")
        positions, missed, depth = surface(view.camera)
        image = np.where(missed[:, None], 0.3, ball.colours(positions, view.camera.centre))
        image = (image + noise * generator.normal(size=image.shape)).reshape(HEIGHT, WIDTH, 3)
        write_png(view.path, np.clip(image, 0, 1))
        if depths:
            write_depth(folder / "depth" / f"{view.name}.exr", depth.reshape(HEIGHT, WIDTH))
        views.append(view)
    positions = spiral(1500)
    return make_scene("ball", views, Points(positions, np.full(positions.shape, 128, np.uint8)))


@pytest.fixture(scope="module")
def glossy(tmp_path_factory):
    """A ball of degree 1."""
    return photographed(tmp_path_factory.mktemp("glossy"), Ball(1))


@pytest.fixture(scope="module")
def glossy_choice(glossy):
    return choose_sh_degree(glossy)


@pytest.mark.parametrize("depths", [True, False])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_degree_that_colours_were_made_with(tmp_path, degree, depths):
    choice = choose_sh_degree(photographed(tmp_path, Ball(degree), depths=depths))
    assert choice.degree == degree
    assert len(choice.errors) == 4
    assert choice.errors[degree] <= 1.02 * min(choice.errors)


def test_no_more_than_asked_for(glossy, glossy_choice):
    choice = choose_sh_degree(glossy, most=0)
    assert choice.degree == 0
    assert choice.errors == pytest.approx(glossy_choice.errors[:1], rel=1e-9)
    with pytest.raises(ValueError, match="degree 4"):
        choose_sh_degree(glossy, most=4)


def test_the_same_scene_gives_the_same_choice(glossy, glossy_choice):
    assert choose_sh_degree(glossy) == glossy_choice


def streaked(scene: Scene) -> Scene:
    """Bright upright lines in every view, and drops that stay on the lens."""
    generator = np.random.default_rng(5)
    for view in scene.views:
        image = view.image().copy()
        for x, y in zip(generator.integers(0, WIDTH, 60), generator.integers(0, HEIGHT - 12, 60), strict=True):
            image[y : y + 12, x] = 0.6 * image[y : y + 12, x] + 0.4
        for x, y in ((20, 30), (50, 22), (60, 50)):
            image[y : y + 9, x : x + 9] = image[y : y + 9, x : x + 9].mean(axis=(0, 1)) + 0.15
        write_png(view.path, np.clip(image, 0, 1))
    return scene


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_rain_does_not_raise_the_degree(tmp_path, degree):
    assert choose_sh_degree(streaked(photographed(tmp_path, Ball(degree)))).degree <= degree


def test_what_masks_hide_is_not_looked_at(tmp_path, glossy, glossy_choice):
    """A third of every picture is replaced by something strange, and masked."""
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[:, : WIDTH // 3] = True
    write_ignored(tmp_path / "mask.png", hidden)
    masked, spoilt = [], []
    for number, view in enumerate(glossy.views):
        masked.append(replace(view, mask=tmp_path / "mask.png"))
        spoilt.append(replace(masked[-1], path=tmp_path / "clean" / view.path.name))
        write_png(spoilt[-1].path, np.where(hidden[..., None], number % 2, view.image()))
        write_depth(tmp_path / "depth" / f"{view.name}.exr", surface(view.camera)[2].reshape(HEIGHT, WIDTH))
    choices = [choose_sh_degree(make_scene("ball", views, glossy.points)) for views in (masked, spoilt)]
    assert choices[0] == choices[1]
    assert choices[0].patches < glossy_choice.patches
    assert choices[0].degree == 1


@pytest.mark.parametrize("points", [no_points(), Points(spiral(30), np.zeros((30, 3), np.uint8))])
def test_too_few_points_leave_the_highest_degree_and_say_so(glossy, points):
    choice = choose_sh_degree(replace(glossy, points=points), most=2)
    assert (choice.degree, choice.errors) == (2, ())
    assert "too few" in choice.reason


def test_too_few_views_leave_the_highest_degree(tmp_path):
    choice = choose_sh_degree(photographed(tmp_path, Ball(0), n_views=FEWEST_VIEWS))
    assert (choice.degree, choice.views) == (3, FEWEST_VIEWS - 1)


def test_points_that_are_nowhere_are_left_out(glossy, glossy_choice):
    positions = np.concatenate([[[np.nan, 0, 0], [0, np.inf, 0]], glossy.points.positions, [[0, 0, -np.inf]]])
    odd = replace(glossy, points=Points(positions, np.zeros(positions.shape, np.uint8)))
    assert choose_sh_degree(odd) == glossy_choice


def test_held_out_views_are_not_looked_at(tmp_path):
    scene = photographed(tmp_path, Ball(1), n_views=8)
    for view in scene.test_views:
        view.path.unlink()
    assert choose_sh_degree(scene).views == len(scene.train_views)
    scene.train_views[3].path.unlink()
    with pytest.raises(InputError, match="no such image"):
        choose_sh_degree(scene)


def test_the_closed_form_is_leaving_each_view_out():
    """Taking a view's samples away and predicting them again gives the hat matrix's answer."""
    generator = np.random.default_rng(0)
    colours, weights = generator.normal(size=(2, 12, 3)), generator.uniform(0.3, 1, (2, 12))
    values = module._basis(2, generator.normal(size=(2, 12, 3)))
    fast = dict(
        zip(itertools.product(module.RIDGES, range(3)), module._left_out(colours, weights, values, 2), strict=True)
    )
    for (ridge, degree), patch, view in itertools.product(fast, range(2), range(12)):
        rest, n = np.arange(12) != view, (degree + 1) ** 2
        b, w = values[patch][rest, :n], weights[patch][rest, None]
        penalty = np.diag([1e-9] + (n - 1) * [ridge])
        solution = np.linalg.solve(b.T @ (w * b) + penalty, b.T @ (w * colours[patch][rest]))
        assert fast[ridge, degree][patch, view] == pytest.approx(values[patch, view, :n] @ solution, abs=1e-6)


@pytest.mark.parametrize("depths", [True, False])
def test_points_behind_others_are_not_seen(tmp_path, depths):
    samples = sample_views(photographed(tmp_path, Ball(0), depths=depths))
    facing = np.einsum("pk,pvk->pv", samples.positions, samples.centres - samples.positions[:, None]) > 0
    assert samples.seen[~facing].mean() < 0.01
    assert samples.seen[facing].mean() > 0.4
