"""The loop, and that Ctrl-C and SIGTERM leave no trace in any kind of training."""

import csv
import multiprocessing
import os
import signal
from dataclasses import replace
from functools import partial

import balls
import numpy as np
import pytest
import tiny_attention
from splats import photographed
from threadpoolctl import threadpool_info, threadpool_limits
from tiny_network import TINY
from trainings import BUDGETED, CONFIG
from wet import lens, photograph

from baselines.derain_nerf.raindrop_attention.pairs import Patches
from baselines.derain_nerf.raindrop_attention.training import AttentionTraining
from baselines.splatting import trainer as splatting
from baselines.splatting.objective import Objective
from baselines.supervised.config import Intervals
from baselines.supervised.training import CURVE, train
from baselines.training import loop
from baselines.training.checkpoints import CHECKPOINT, load_checkpoint, save_checkpoint
from baselines.training.images import read_images
from baselines.training.learning_curve import LEARNING_CURVE, ROWS
from baselines.volumetric import trainer as volumetric
from baselines.volumetric.model import RadianceModel
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.pairs import Batches, Pairs
from deraings.enhancement.training.training import EnhancementTraining
from hydroviews.pairs.rainy_pairs import DrawnRain
from leaderboard.site.learning_curves import learning_curves

INTERVALS = Intervals(checkpoint_seconds=1e9, validate_every=2)


class Learning(Objective):
    """Also learns every view's mean loss, and weighs the view by it."""

    def __init__(self, images):
        super().__init__(images)
        self.means = np.ones(len(images))

    def __call__(self, image, view, iteration, buffers):
        loss, gradient = super().__call__(image, view, iteration, buffers)
        self.means[view] += 0.5 * (loss - self.means[view])
        return loss, gradient * np.float32(self.means[view])

    def state_dict(self):
        return {"means": self.means.copy()}

    def load_state_dict(self, arrays):
        self.means = arrays["means"].copy()


def of_splats(config, kind, folder, scene):
    trained = splatting.train(scene, config, 0, folder, kind(read_images(scene.train_views)))
    return list(trained.gaussians.state_dict().values())


def of_a_field(folder, scene):
    config = replace(balls.SMALL, iterations=30, rays=64, checkpoint_seconds=1e9)
    trained = volumetric.train(scene, config, 0, folder, lambda s, g, _: RadianceModel(config, s, g))
    return [value.numpy() for value in trained.model.state_dict().values()]


def drawn():
    return DrawnRain([{96: photograph()}], {(96, 64): (lens(),)}, {"raindrop": 1.0})


def weights(*networks):
    return [parameter.detach().numpy() for network in networks for parameter in network.parameters()]


def of_enhancement(folder, _, workers=0):
    config = TrainingConfig(network=TINY, steps=5, batch=2, patch=32, warm_up=2, precision="float32")
    pairs = Pairs(drawn(), [], config.patch, config.seed, misted=1)
    trained = EnhancementTraining(config)
    train(trained, Batches(pairs, config.batch), folder, "drops", lambda _: {"score": 1.0}, INTERVALS, workers)
    return weights(trained.network, trained.averaged)


def of_attention(folder, _):
    config = replace(tiny_attention.TRAINING, steps=5, removal_every=2)
    patches = Patches(drawn(), config.patch, config.crops, config.batch, config.seed)
    trained = AttentionTraining(config)
    train(trained, patches, folder, "drops", lambda _: {"score": 1.0}, INTERVALS)
    return weights(trained.generator, trained.discriminator, trained.averaged)


PATIENT = {"checkpoint_seconds": 1e9}
TRAININGS = {  # with the steps after which a signal comes: early, and in the middle
    "densification": (partial(of_splats, replace(CONFIG, **PATIENT), Objective), (1, 100)),
    "relocation": (partial(of_splats, replace(BUDGETED, **PATIENT), Objective), (1, 100)),
    "an objective that learns": (partial(of_splats, replace(CONFIG, iterations=60, **PATIENT), Learning), (1, 30)),
    "a field": (of_a_field, (1, 17)),
    "enhancement": (of_enhancement, (1, 3)),
    "raindrop attention": (of_attention, (1, 4)),
}


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    splats, ball = (tmp_path_factory.mktemp(name) for name in ("splats", "ball"))
    return {"a field": balls.photographed(ball), "any other": photographed(splats)}


@pytest.fixture(scope="module")
def left_alone(scenes, tmp_path_factory):
    """What a training ends with that nobody disturbs, by name; every one is trained once."""
    ends = {}

    def end(name):
        if name not in ends:
            ends[name] = TRAININGS[name][0](tmp_path_factory.mktemp("run"), scenes.get(name, scenes["any other"]))
        return ends[name]

    return end


def interrupting(monkeypatch, at, number):
    """Send a signal in the middle of a step, as a terminal does: to the processes that it has started as well.

    Returns the iterations that were begun.
    """
    run, iterations = loop.run, []

    def watched(trainer, *arguments):
        step = trainer.step

        def interrupted():
            iterations.append(trainer.iteration)
            if trainer.iteration == at:
                for process in (os.getpid(), *(child.pid for child in multiprocessing.active_children())):
                    os.kill(process, number)
            return step()

        trainer.step = interrupted
        return run(trainer, *arguments)

    for module in (loop, splatting, volumetric):
        monkeypatch.setattr(module, "run", watched)
    return iterations


def interrupted_at(moments, train, monkeypatch, number=signal.SIGINT, error=KeyboardInterrupt):
    """Sessions of a training that a signal ends: the first and the last iteration that each began, its exit status."""
    handler, sessions = signal.getsignal(number), []
    for moment in moments:
        with monkeypatch.context() as patch:
            begun = interrupting(patch, moment, number)
            with pytest.raises(error) as end:
                train()
        assert signal.getsignal(number) is handler
        sessions.append((begun[0], begun[-1], getattr(end.value, "code", None)))
    return sessions


def assert_same_bits(one, other):
    assert [values.tobytes() for values in one] == [values.tobytes() for values in other]


@pytest.mark.parametrize(
    ("name", "number", "error", "exit_status"),
    [
        *((name, signal.SIGINT, KeyboardInterrupt, None) for name in TRAININGS),
        ("densification", signal.SIGTERM, SystemExit, 128 + signal.SIGTERM),
    ],
)
def test_a_signal_ends_a_training_after_its_step_and_leaves_no_trace(
    name, number, error, exit_status, scenes, left_alone, tmp_path, monkeypatch
):
    train, (early, late) = TRAININGS[name]
    expected, session = left_alone(name), partial(train, tmp_path, scenes.get(name, scenes["any other"]))
    # No step is begun after the signal, and none is done again in the second session.
    begun = [(0, early, exit_status), (early + 1, late, exit_status)]
    assert interrupted_at((early, late), session, monkeypatch, number, error) == begun
    assert_same_bits(session(), expected)


def test_the_curve_goes_on_over_sessions(tmp_path, monkeypatch):
    session = partial(of_enhancement, tmp_path, None)
    interrupted_at((2, 3), session, monkeypatch)
    session()
    rows = (tmp_path / CURVE).read_text().splitlines()[1:]
    assert [row.split(",")[0] for row in rows] == ["2", "4", "5"]


def test_ctrl_c_that_workers_get_as_well_ends_the_training_after_its_step(left_alone, tmp_path, monkeypatch):
    expected, session = left_alone("enhancement"), partial(of_enhancement, tmp_path, None, workers=2)
    interrupted_at((2,), session, monkeypatch)
    assert not multiprocessing.active_children()  # none is left to be waited for
    assert_same_bits(session(), expected)


class Counting:
    """A training that adds up numbers."""

    def __init__(self, iterations=10, losses=None):
        self.iterations, self.iteration, self.seconds, self.total = iterations, 0, 0.0, np.zeros(1)
        self.losses = losses or {}

    @property
    def finished(self):
        return self.iteration >= self.iterations

    def step(self):
        self.total += self.iteration
        self.iteration += 1
        return {"loss": self.losses.get(self.iteration - 1, 0.5), "numbers": self.iteration}

    def state_dict(self):
        return {"iteration": self.iteration, "seconds": self.seconds, "sums": {"total": self.total}}

    def load_state_dict(self, tree):
        self.iteration, self.seconds, self.total = tree["iteration"], tree["seconds"], tree["sums"]["total"]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_loss_that_is_not_finite_never_gets_into_a_checkpoint(tmp_path, bad):
    path = tmp_path / CHECKPOINT
    with pytest.raises(FloatingPointError, match=r"iteration 4 is not finite: loss (nan|inf)"):
        loop.run(Counting(losses={4: bad}), path, {"seed": 0}, 0.0)
    assert load_checkpoint(path, {"seed": 0})["iteration"] == 4
    trainer = Counting()
    loop.run(trainer, path, {"seed": 0}, 0.0)
    assert trainer.total == sum(range(10))


def test_checkpoints_are_written_when_due_and_at_the_end(tmp_path, monkeypatch):
    written = []
    monkeypatch.setattr(loop, "save_checkpoint", lambda path, tree, _: written.append(tree["iteration"]))
    loop.run(Counting(), tmp_path / CHECKPOINT, {}, 1e9)
    assert written == [10]
    loop.run(Counting(), tmp_path / CHECKPOINT, {}, 0.0)
    assert written[1:] == list(range(1, 11))


def test_seconds_of_an_earlier_session_count(tmp_path):
    path, trainer = tmp_path / CHECKPOINT, Counting()
    save_checkpoint(path, {"iteration": 4, "seconds": 1000.0, "sums": {"total": np.full(1, 6.0)}}, {})
    loop.run(trainer, path, {}, 1e9)
    assert trainer.seconds > 1000
    assert float(learning_curve(tmp_path)[-1]["seconds"]) >= 1000


def learning_curve(folder):
    return list(csv.DictReader((folder / LEARNING_CURVE).open()))


def test_the_learning_curve_has_means_of_losses_and_the_counts_of_then(tmp_path):
    trainer = Counting(250, {step: float(step) for step in range(250)})
    loop.run(trainer, tmp_path / CHECKPOINT, {}, 1e9)
    rows = learning_curve(tmp_path)
    assert len(rows) == 84 <= ROWS  # every third step, and the last one
    assert list(rows[0]) == ["step", "seconds", "loss", "numbers"]
    told = [" ".join(row[name] for name in ("step", "loss", "numbers")) for row in rows]
    assert (told[0], told[1], told[-1]) == ("3 1 3", "6 4 6", "250 249 250")
    seconds = [float(row["seconds"]) for row in rows]
    assert seconds == sorted(seconds)
    assert seconds[-1] == pytest.approx(trainer.seconds, rel=1e-5)


def test_a_kill_after_the_last_checkpoint_leaves_the_whole_learning_curve(tmp_path, monkeypatch):
    """A finished training has no further step after which it could be written."""

    def killed(*arguments):
        save_checkpoint(*arguments)
        raise SystemExit

    with monkeypatch.context() as patch, pytest.raises(SystemExit):
        patch.setattr(loop, "save_checkpoint", killed)
        loop.run(Counting(), tmp_path / CHECKPOINT, {}, 1e9)
    loop.run(Counting(), tmp_path / CHECKPOINT, {}, 1e9)
    assert learning_curve(tmp_path)[-1]["step"] == "10"


class Changing(Counting):
    """Has a loss in every fourth step alone, and from step 100 on another one and another count."""

    def step(self):
        done, metrics = self.iteration, super().step()
        some = {"now and then": float(done)} if done % 4 == 0 else {}
        return metrics | some | ({"late": 2.0 * done, "late numbers": done} if done >= 100 else {})


def test_losses_that_come_later_or_are_not_in_every_step_have_columns_and_means_of_their_own(tmp_path):
    loop.run(Changing(250), tmp_path / CHECKPOINT, {}, 1e9)
    rows = learning_curve(tmp_path)  # every third step
    assert list(rows[0]) == ["step", "seconds", "loss", "numbers", "now and then", "late", "late numbers"]
    told = [" ".join(row[name] for name in ("step", "now and then", "late", "late numbers")) for row in rows]
    assert told[:4] == ["3 0 nan nan", "6 4 nan nan", "9 8 nan nan", "12 nan nan nan"]
    assert told[33:35] == ["102 100 201 101", "105 104 206 104"]  # the first has steps 99 to 101
    assert {curve.name: len(curve.points.split()) for curve in learning_curves(tmp_path)} == {
        "loss": 84, "numbers": 84, "now and then": 63, "late": 51, "late numbers": 51
    }  # fmt: skip


def test_a_learning_curve_whose_losses_change_goes_on_over_sessions(tmp_path, monkeypatch):
    loop.run(Changing(250), tmp_path / "alone" / CHECKPOINT, {}, 1e9)
    moments = (0, 1, 98, 100, 103)  # the first before any row is there, others within one
    interrupted_at(moments, lambda: loop.run(Changing(250), tmp_path / CHECKPOINT, {}, 1e9), monkeypatch)
    loop.run(Changing(250), tmp_path / CHECKPOINT, {}, 1e9)
    rows, expected = (learning_curve(folder) for folder in (tmp_path, tmp_path / "alone"))
    assert [row | {"seconds": ""} for row in rows] == [row | {"seconds": ""} for row in expected]


@pytest.mark.parametrize("columns", [[], ["step", "seconds", "loss", "numbers"]])
def test_a_learning_curve_of_an_older_checkpoint_goes_on(tmp_path, columns):
    path, rows = tmp_path / CHECKPOINT, [[3, 1.0, 1.0, 3]] if columns else []
    curve = {"columns": columns, "rows": rows, "sums": {"loss": 7.0, "numbers": 5}, "steps": 2}
    state = {"iteration": 5, "seconds": 1.0, "sums": {"total": np.zeros(1)}, "learning curve": curve}
    save_checkpoint(path, state, {})
    loop.run(Counting(250, {5: 5.0}), path, {}, 1e9)
    row = learning_curve(tmp_path)[len(rows)]
    assert (row["step"], row["loss"], row["numbers"]) == ("6", "4", "6")


def blas_threads():
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def test_products_have_one_thread_while_a_training_runs(tmp_path, monkeypatch):
    threads, step = set(), Counting.step

    def watched(trainer):
        threads.update(blas_threads())
        return step(trainer)

    monkeypatch.setattr(Counting, "step", watched)
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        assert 2 in before  # some of them know no threads
        loop.run(Counting(), tmp_path / CHECKPOINT, {}, 1e9)
        assert blas_threads() == before
    assert threads == {1}
