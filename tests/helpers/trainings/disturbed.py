"""Scenes whose photographs were changed, and trainings on them, undisturbed or broken off."""

from contextlib import contextmanager
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest

from baselines.method import check_hidden
from baselines.splatting.gaussians import FIELDS
from hydroviews.scene.images import write_png


def fitted(kind, config, scene, folder, seed=0):
    """A method of a class, trained."""
    method = kind(config, seed)
    method.fit(scene, folder)
    return method


def assert_same_gaussians(one, other):
    """To the bit."""
    for name in FIELDS:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


@contextmanager
def power_cut(module, objective, iteration=9, step="__call__"):
    """Trainings with the objective of that name in a module break off at an iteration."""
    kind = getattr(module, objective)

    def cut(self, *arguments):  # image or images, view, iteration, buffers
        if arguments[2] == iteration:
            raise RuntimeError("power cut")
        return getattr(kind, step)(self, *arguments)

    interrupted = type(objective, (kind,), {step: cut})  # of the same name, which a checkpoint holds
    with mock.patch.object(module, objective, interrupted), pytest.raises(RuntimeError, match="power cut"):
        yield


def assert_found(method, shown, scene):
    """What a trained method hides of its training views is what stands in the way there, more than half of it."""
    inside, outside = [], []
    for index, (view, clean) in enumerate(zip(shown.train_views, scene.train_views, strict=True)):
        image = view.image()
        plane = method.hidden(index, image.shape[:2])
        check_hidden(plane, image.shape[:2])
        there = (np.abs(image - clean.image()) > 0.02).any(axis=2)
        inside.append(plane[there])
        outside.append(plane[~there])
    assert np.concatenate(inside).mean() > 0.5
    assert np.concatenate(outside).mean() < 0.2


def whole_and_resumed(kind, config, scene, folder, module, objective):
    """A method trained at one go, and one whose training broke off and went on: to the same bits."""
    whole = fitted(kind, config, scene, folder / "whole")
    with power_cut(module, objective):
        fitted(kind, config, scene, folder / "cut")
    resumed = fitted(kind, config, scene, folder / "cut")
    assert_same_gaussians(whole._trained.gaussians, resumed._trained.gaussians)
    return whole, resumed


def disturbed(scene, folder, change):
    """The scene with other photographs: `change` of a picture [H, W, 3] and the index of its view."""
    views = []
    for index, view in enumerate(scene.views):
        write_png(folder / view.path.name, np.clip(change(view.image().copy(), index), 0, 1))
        views.append(replace(view, path=folder / view.path.name))
    return replace(scene, views=tuple(views))


def only_in_training(scene, change):
    """The change of training views alone."""
    return lambda picture, index: change(picture, index) if scene.views[index].name in scene.split.train else picture


def behind_squares(scene, folder):
    """A yellow square, 12 pixels wide, before every third training view of 24 x 32 pixels, each time elsewhere."""
    places = np.random.default_rng(0).integers(0, (12, 20), (len(scene.views), 2))

    def paste(picture, index):
        if index % 3 == 1:
            top, left = places[index]
            picture[top : top + 12, left : left + 12] = (1.0, 0.9, 0.1)
        return picture

    return disturbed(scene, folder, only_in_training(scene, paste))


def in_casts(scene, folder):
    """Each training view darker by a factor a channel."""
    casts = np.random.default_rng(0).uniform(0.3, 1.0, (len(scene.views), 3))
    return disturbed(scene, folder, only_in_training(scene, lambda picture, index: picture * casts[index]))


def held_out(method, scene, gains=False):
    """PSNR of the held-out views; with a gain a channel fitted, as the mean of colour casts cannot be known."""
    renders = np.stack([method.render(view.camera) for view in scene.test_views]).reshape(-1, 3)
    truths = np.stack([view.image() for view in scene.test_views]).reshape(-1, 3)
    if gains:
        renders = renders * (renders * truths).sum(0) / (renders**2).sum(0)
    return -10 * np.log10(np.mean((renders - truths) ** 2))


def occluded(scene, folder, size=48, seed=0):
    """A yellow square before every third view, each time elsewhere."""
    height, width = scene.views[0].camera.height, scene.views[0].camera.width
    places = (np.random.default_rng(seed).uniform(0.15, 0.35, (len(scene.views), 2)) * (height, width)).astype(int)

    def pasted(image, index):
        if index % 3 == 1:
            y, x = places[index]
            image[y : y + size, x : x + size] = (1.0, 0.9, 0.1)
        return image

    return disturbed(scene, folder, pasted)
