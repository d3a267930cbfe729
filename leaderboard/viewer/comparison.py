"""One view of a run beside its photograph."""

from dataclasses import dataclass

from baselines.method import Method
from hydroviews.dataset.variants import has_clean
from hydroviews.metrics import METRICS
from hydroviews.scene.images import Image, to_uint8
from hydroviews.scene.scenes import View
from leaderboard.runs.run import Run
from leaderboard.scoring.previews import error_map
from leaderboard.scoring.score import score_image

SHOWN = METRICS[0]  # the one that takes no time to compute


@dataclass(frozen=True)
class Shot:
    """A view as the viewer shows it: a photograph that was trained on, or a held-out one, clean if there is one."""

    view: View
    held_out: bool
    scored: bool  # held out and clean

    @property
    def label(self) -> str:
        """What it is listed as."""
        return f"{self.view.name} (held out)" if self.held_out else self.view.name


@dataclass(frozen=True)
class ComparedView:
    """The photograph, what the trained scene looks like from its camera, where they differ: each [H, W, 3]."""

    photograph: Image
    render: Image
    error: Image
    score: float | None  # by SHOWN, as the leaderboard counts it; None where the view is not scored


def list_shots(run: Run) -> list[Shot]:
    """The photographs the run was trained on, then the held-out views."""
    training = run.training_scene()
    scored = has_clean(run.data / run.scene)
    held_out = run.clean_scene() if scored else training
    seen = [Shot(view, held_out=False, scored=False) for view in training.train_views]
    return seen + [Shot(view, held_out=True, scored=scored) for view in held_out.test_views]


def compare(method: Method, shot: Shot) -> ComparedView:
    """Render a view and hold it against its photograph; both are 8-bit, as they are scored."""
    photograph, ignored = shot.view.image(), shot.view.ignored()
    render = to_uint8(method.render(shot.view.camera)).astype("float32") / 255
    error = error_map(render, photograph, ignored)
    score = score_image(render, shot.view, {}, [SHOWN])[SHOWN.name] if shot.scored else None
    return ComparedView(photograph, render, error, score)
