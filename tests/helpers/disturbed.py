"""Scenes whose photographs were changed, and trainings on them."""

from dataclasses import replace

import numpy as np

from hydroviews.scene.images import write_png


def fitted(kind, config, scene, folder, seed=0):
    """A method of a class, trained."""
    method = kind(config, seed)
    method.fit(scene, folder)
    return method


def disturbed(scene, folder, change):
    """The scene with other photographs: `change` of a picture [H, W, 3] and the index of its view."""
    views = []
    for index, view in enumerate(scene.views):
        write_png(folder / view.path.name, np.clip(change(view.image().copy(), index), 0, 1))
        views.append(replace(view, path=folder / view.path.name))
    return replace(scene, views=tuple(views))


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
