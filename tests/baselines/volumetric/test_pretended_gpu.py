"""A radiance field on a pretended GPU: some steps, interrupted, resumed on another card, saved and rendered."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from balls import SMALL, photographed
from pretended_gpu import NAME
from splats import camera

from baselines.volumetric.method import RadianceMethod
from baselines.volumetric.trainer import FieldTrainer

BRIEF = replace(SMALL, iterations=4, rays=32, proposal_samples=8, samples=4, checkpoint_seconds=0.0)


def test_a_field_trains_goes_on_on_another_card_and_comes_back(pretended_gpu, tmp_path, monkeypatch):
    def lost(trainer):
        if trainer.iteration == 2 and not cards:
            cards.append("another card")
            raise KeyboardInterrupt
        return step(trainer)

    step, cards = FieldTrainer.step, []
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cuda")
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda *_: (cards or [NAME])[0])
    monkeypatch.setattr(FieldTrainer, "step", lost)
    scene, folder = photographed(tmp_path / "scene", n_views=8), tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        RadianceMethod(BRIEF, 0).fit(scene, folder)
    method = RadianceMethod(BRIEF, 0)
    method.fit(scene, folder)
    method.save(folder)
    picture = method.render(camera(12, 8))
    assert np.isfinite(picture).all()
    assert (method.summary().device, method.summary().render_device) == ("another card", "another card")

    assert np.array_equal(RadianceMethod.load(BRIEF, 0, folder).render(camera(12, 8)), picture)
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cpu")
    summary = RadianceMethod.load(BRIEF, 0, folder).summary()
    assert (summary.device, summary.render_device) == ("another card", "cpu")
