"""A run's Gaussians as one file for viewers."""

import logging
from pathlib import Path
from typing import Literal

from baselines.splatting.files.compact import cut_to_degree, without_unseen, write_compressed_ply
from baselines.splatting.files.ply import write_ply
from hydroviews.errors import InputError
from hydroviews.files.ownership import require_ours
from leaderboard.runs.finished_runs import find_splats, require_finished

logger = logging.getLogger(__name__)

Format = Literal["ply", "compressed"]


def export(folder: Path, out: Path, form: Format, sh_degree: int | None) -> None:
    """Write a run's Gaussians for viewers.

    Args:
        folder: of a finished run.
        out: the file, .ply.
        form: "ply", which shows the same as the run's own splats.ply; or "compressed", a few bits a number.
        sh_degree: leave out spherical harmonics above this degree; None keeps all.

    Raises:
        InputError: no such run, a method without Gaussians, another suffix, a file of somebody else's of
            that name, a degree that there is not, or no gsply.
    """
    if out.suffix.lower() != ".ply":
        raise InputError(f"--out {out}: not a splat file", expected="a name that ends in .ply")
    require_ours([out])
    require_finished(folder)
    gaussians = find_splats(folder)
    if gaussians is None:
        raise InputError(f"{folder}: its method leaves no Gaussians", fix="choose a run of a method that does, as 3dgs")
    shown = without_unseen(gaussians)
    if sh_degree is not None:
        shown = cut_to_degree(shown, sh_degree)
    if form == "compressed":
        write_compressed_ply(out, shown)
    else:
        write_ply(out, shown, normals=False)
    size = out.stat().st_size / 1e6
    logger.info("%s: %s Gaussians, degree %d, %.2f MB", out, f"{len(shown):,}", shown.sh_degree, size)
