"""Every registered method keeps its contract, resumes to the same bits, and survives scenes that teach little."""

import shutil
import signal
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from baselines.masking.uncertainty import UncertaintyConfig
from baselines.method import METHODS, find_method
from baselines.nimbus.config import MediumConfig
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.training import loop
from baselines.training.torch_state import one_thread
from baselines.volumetric.config import VolumetricConfig
from baselines.wild_gs.config import LookConfig
from deraings.masks.config import MaskConfig
from hydroviews.cli.plugins import registered
from hydroviews.scene.images import write_png
from leaderboard.contract import checks
from leaderboard.contract.case import Case, must_equal
from leaderboard.contract.trials import CHECKS
from leaderboard.runs.train_and_render import only_training

STEPS, INTERRUPTED = 12, 7
# Settings that count in steps would begin after so short a training; shares of the steps need no change.
EARLY = {
    DefaultStrategy: {"start": 3, "stop": 11, "every": 4, "grow_grad2d": 1e-7},
    TrainerConfig: {"sh_degree_interval": 4, "dense_start": 0.0},
    VolumetricConfig: {"rays": 256, "warm_up": 2, "anneal": 6},
    UncertaintyConfig: {"start": 4, "warm_up": 4, "protected": 0, "first_lesson": 1, "every": 2},
    MediumConfig: {"renewed": 3, "least": 0.0},
    LookConfig: {"renewed": 4},
    MaskConfig: {"every": 2, "min_evidence": 0.0},
}
IN_PROCESS = [name for name, check in CHECKS.items() if check.__module__ == checks.__name__]
TEACH_LITTLE = {
    "grey": lambda pixels, _: np.full_like(pixels, 0.5),
    "noise": lambda pixels, index: np.random.default_rng(index).random(pixels.shape).astype(np.float32),
    "one view": lambda pixels, _: pixels,
}


def early(settings):
    """The same settings with everything in them that begins late begun early."""
    if not is_dataclass(settings) or isinstance(settings, type):
        return settings
    changes = {field.name: early(getattr(settings, field.name)) for field in fields(settings)}
    return replace(settings, **{**changes, **EARLY.get(type(settings), {})})


class ShortCase(Case):
    """A method on the room, with settings that use all of the method within few steps."""

    def config(self, steps=None):
        usual = self.kind.with_max_iterations(self.kind.configuration(self.profile), STEPS)
        return self.kind.with_max_iterations(early(usual), steps or self.steps)


@pytest.fixture(autouse=True)
def _one_thread():
    """As sweeps run methods: cr-nerf's convolutions add up in another order in every run on several threads."""
    with one_thread():
        yield


@pytest.fixture(scope="session")
def cases(tmp_path_factory):
    """The case of every method by name: what one trains, the tests of a method share."""
    made = tmp_path_factory.mktemp
    return {name: ShortCase(name, find_method(name), "demo", STEPS, made(name)) for name in registered(METHODS)}


@pytest.fixture(params=list(registered(METHODS)))
def case(request, cases):
    """A method's case; the runs of which the checks ask no more than that they have ended are copies of its first."""
    one = cases[request.param]
    assert one.trained
    for run in ("finished", "foreign"):
        if not (one.folder / run).exists():
            shutil.copytree(one.folder / "trained", one.folder / run)
    return one


@pytest.mark.parametrize("check", IN_PROCESS)
def test_it_keeps_its_promises(case, check):
    assert CHECKS[check](case)


def test_ctrl_c_half_way_leaves_no_trace(case, monkeypatch):
    """Learned weights, masks, media and layers go on as they were."""
    finite = loop.check_finite

    def interrupt(metrics, iteration):
        finite(metrics, iteration)
        if iteration == INTERRUPTED:
            signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(loop, "check_finite", interrupt)
        case.train(case.scene, "interrupted")
    resumed = case.train(case.scene, "interrupted")
    must_equal(case.renders(resumed), case.pixels, "interrupted, it renders other pixels")
    assert resumed.summary().used == case.trained.summary().used
    hidden, others = (method.hidden(0, (20, 30)) for method in (case.trained, resumed))
    assert (hidden is None) == (others is None)
    assert hidden is None or np.array_equal(hidden, others)


@pytest.mark.parametrize("lesson", TEACH_LITTLE)
def test_scenes_that_teach_little_are_learned_without_harm(case, lesson):
    scene = case.room(lesson)
    for index, view in enumerate(scene.train_views):
        write_png(view.path, TEACH_LITTLE[lesson](view.image(), index))
    if lesson == "one view":
        scene = replace(scene, split=replace(scene.split, train=scene.split.train[:1]))
    folder = case.folder / f"taught-{lesson}"
    folder.mkdir()
    method = case.kind(case.config(), 0)
    method.fit(only_training(scene), folder)
    assert np.isfinite(method.render(scene.test_views[0].camera)).all()
