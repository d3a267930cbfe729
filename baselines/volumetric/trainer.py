"""The training of radiance models: ray batches, Adam, checkpoints. What is learnt is the model's and the loss's."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.training.checkpoints import check_fingerprint, fingerprint_of, read_arrays, write_arrays
from baselines.training.devices import chosen_device
from baselines.training.images import TrainingImages, read_images
from baselines.training.stopping import Clock, Saving, end_stopped, stop_signals
from baselines.training.torch_state import module_arrays, restore_module
from baselines.volumetric.batches import Batch, TrainingPixels
from baselines.volumetric.config import VolumetricConfig
from baselines.volumetric.hash_grid import warm_up
from baselines.volumetric.losses import Loss, photometric_terms
from baselines.volumetric.model import Practice, RadianceModel
from baselines.volumetric.sampling import annealed
from baselines.volumetric.spaces import Space, choose_space
from hydroviews.scene.scenes import Scene
from hydroviews.scene.seeds import generator

CHECKPOINT = "checkpoint.safetensors"
BETAS, EPSILON = (0.9, 0.99), 1e-15  # of Mueller et al. 2022: entries that are rarely seen still move
Make = Callable[[Space, torch.Generator, int], RadianceModel]  # space, start, number of training views


@dataclass(frozen=True)
class Trained:
    """A trained model."""

    model: RadianceModel
    seconds: float  # of training alone, over all sessions
    device: str


def train(
    scene: Scene,
    config: VolumetricConfig,
    seed: int,
    folder: Path,
    make: Make,
    loss: Loss | None = None,
    *,
    about: dict[str, Any] | None = None,
    images: TrainingImages | None = None,
    weights: Sequence[NDArray[np.float32]] | None = None,
) -> Trained:
    """Learn the scene's training views, or go on from the checkpoint in `folder`.

    A run that was interrupted and taken up again ends with the same bits as one that was not, on the CPU and with
    the same number of threads.

    Args:
        scene: training views and points.
        config: settings of rendering and training.
        seed: of everything random.
        folder: where the checkpoint is kept.
        make: the model, untrained.
        loss: of a batch; by default that of a plain field.
        about: settings of `make` and `loss`, for JSON; a checkpoint made with others is refused.
        images: to learn from instead of the photographs.
        weights: how much each pixel counts, [H, W] in [0, 1] a view.

    Raises:
        InputError: no training views; an image that cannot be read; weights of another size; a checkpoint of another
            configuration, seed or scene; no such device.
        FloatingPointError: a loss is NaN or infinite.
        KeyboardInterrupt, SystemExit: on Ctrl-C and SIGTERM, after a checkpoint was written.
    """
    cameras = [view.camera for view in scene.train_views]
    space = choose_space(cameras, scene.points, config.space)
    device = torch.device(chosen_device(config.device))
    pixels = TrainingPixels(cameras, images or read_images(scene.train_views), weights)
    start = generator(seed, "start").integers(2**62)
    model = make(space, torch.Generator().manual_seed(int(start)), len(cameras)).to(device)
    if device.type == "cpu":
        warm_up()
    fingerprint = fingerprint_of(
        config, seed, scene, pixels.images, about=about or {}, weights=pixels.digest(), device=device.type
    )
    run = _Run(config, seed, pixels, loss or photometric_terms(config), device, folder / CHECKPOINT, fingerprint)
    seconds = run.finish(model)
    return Trained(model, seconds, torch.cuda.get_device_name() if device.type == "cuda" else "cpu")


@dataclass(frozen=True)
class _Run:
    """What stays the same from the first step to the last."""

    config: VolumetricConfig
    seed: int
    pixels: TrainingPixels
    loss: Loss
    device: torch.device
    checkpoint: Path
    fingerprint: dict[str, Any]

    def finish(self, model: RadianceModel) -> float:
        """All steps that are left, with a checkpoint now and then and at the end; seconds of training."""
        optimiser = torch.optim.Adam(model.groups(), betas=BETAS, eps=EPSILON, fused=True)
        starting = [group["lr"] for group in optimiser.param_groups]
        done, seconds = self.resume(model, optimiser)
        clock, smooth = Clock(seconds), 0.0
        saving = Saving(clock, self.config.checkpoint_seconds)
        bar = tqdm(total=self.config.iterations, initial=done, desc="training", unit="it", mininterval=1.0)
        with stop_signals() as stopped, bar:
            while done < self.config.iterations:
                for group, rate in zip(optimiser.param_groups, starting, strict=True):
                    group["lr"] = rate * rate_at(done, self.config)
                smooth += (1 if not smooth else 0.02) * (self.step(model, optimiser, done) - smooth)
                done += 1
                if stopped or saving.due:
                    with saving.timed():
                        self.save(model, optimiser, done, clock.seconds)
                end_stopped(stopped)
                bar.set_postfix_str(f"loss {smooth:.4f}", refresh=False)
                bar.update()
        seconds = clock.seconds
        self.save(model, optimiser, done, seconds)
        return seconds

    def step(self, model: RadianceModel, optimiser: torch.optim.Optimizer, iteration: int) -> float:
        """One batch of rays; returns its loss."""
        config = self.config
        batch = self.pixels.draw(self.seed, iteration, config.rays, model.space, self.device)
        terms = self.loss(model(batch.rays, self.practice(batch, iteration)), batch)
        loss = torch.stack(list(terms.values())).sum()
        if not loss.isfinite():  # before it is in every parameter, and in the checkpoint
            told = ", ".join(f"{name} {float(term.detach()):g}" for name, term in terms.items())
            raise FloatingPointError(f"the loss of iteration {iteration} is not finite: {told}")
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        return float(loss.detach())

    def practice(self, batch: Batch, iteration: int) -> Practice:
        """What the step's rendering is told."""
        config = self.config
        numbers = generator(self.seed, "jitter", iteration).random((2, config.rays), np.float32)
        jitter = torch.from_numpy(numbers).to(self.device)
        teach = iteration < config.teach_always or iteration % config.teach_every == 0
        return Practice(batch.views, jitter, annealed(iteration, config.anneal), teach)

    def resume(self, model: RadianceModel, optimiser: torch.optim.Optimizer) -> tuple[int, float]:
        """Iterations and seconds that were done; what they led to is put into model and optimiser."""
        if not self.checkpoint.exists():
            return 0, 0.0
        arrays, about = read_arrays(self.checkpoint)
        check_fingerprint(self.checkpoint, about.get("fingerprint", {}), self.fingerprint)
        restore_module(model, arrays, optimiser)
        return about["iteration"], about["seconds"]

    def save(self, model: RadianceModel, optimiser: torch.optim.Optimizer, iteration: int, seconds: float) -> None:
        """Write the checkpoint."""
        about = {"fingerprint": self.fingerprint, "iteration": iteration, "seconds": seconds}
        write_arrays(self.checkpoint, module_arrays(model, optimiser), about)


def rate_at(iteration: int, config: VolumetricConfig) -> float:
    """Share of the learning rate: rises linearly, falls exponentially."""
    rising = min(1.0, (iteration + 1) / config.rising) if config.rising else 1.0
    return float(rising * config.final_rate ** (iteration / config.iterations))
