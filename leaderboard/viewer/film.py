"""A film of a finished run."""

from pathlib import Path

from baselines.rendering.film import FilmChoice, draw_film, require_suffix
from hydroviews.files.atomic import read_json
from hydroviews.files.ownership import require_ours
from leaderboard.runs.finished_runs import load_method, open_run
from leaderboard.runs.own_files import PREDICTION


def film(folder: Path, data: Path, out: Path, choice: FilmChoice) -> None:
    """Render a camera path through a run's scene to a film.

    Args:
        folder: of a finished run.
        data: the folder that `make eval` built in.
        out: the film, .mp4 or .webm.
        choice: how long, how smooth, how large.

    Raises:
        InputError: no such run, another suffix, no encoder, or a file of somebody else's has that name.
    """
    require_suffix(out)
    require_ours([out])
    run = open_run(folder, data)
    about = {"run": str(run.folder), "trained": read_json(run.folder / PREDICTION)}
    draw_film(load_method(run), run.training_scene(), out, choice, about)
