"""Renders that somebody else made for the held-out views of a known data set, scored as our own runs are.

FOLDER/submission.toml                            what was run, by whom, with what: see `Submission`
FOLDER/<scene>/<pattern>/seed-<n>/<view>.png      8-bit RGB, one for every held-out view

No code of theirs runs. What is accepted becomes a run's folder, without a model.
"""

import json
import logging
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

import pydantic
from pydantic import AfterValidator, Field, StringConstraints
from pydantic.dataclasses import dataclass

from baselines.method import METHODS
from hydroviews.cli.plugins import registered
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import data_hash, read_manifest
from hydroviews.dataset.variants import has_clean, is_captured
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import as_file, write_bytes, write_json
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.ownership import LISTS
from hydroviews.files.settings_guard import claim_folder
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.photographs import some
from hydroviews.scene.images import read_pixels
from hydroviews.scene.scenes import View
from leaderboard.gather import write_leaderboard
from leaderboard.records import NOTED, RAINY_POSES, STRICT, SUBMITTED, Count, Number, Record, in_words
from leaderboard.runs.own_files import PREDICTION
from leaderboard.runs.run import Run
from leaderboard.runs.sessions import CONFIG
from leaderboard.scoring.score import pixel_format, render_format, renders_sha256, score

logger = logging.getLogger(__name__)

ABOUT = "submission.toml"
SIGNATURE = b"\x89PNG\r\n\x1a\n"
Words = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]


def _with_host(link: str) -> str:
    """Refuse, with a ValueError, an address that has no host or cannot be taken apart."""
    if not urlsplit(link).hostname:
        raise ValueError("no host in it")
    return link


Link = Annotated[str, StringConstraints(max_length=200, pattern=r"^https?://[!-~]+$"), AfterValidator(_with_host)]
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True, config=STRICT)
class SubmittedRun:
    """One training of the method: [[runs]] in the TOML file."""

    scene: str
    pattern: str  # such as raindrop-1; clean for a method that was shown clean views
    data_sha256: Digest  # of the data that it was trained on: column data_sha256 of any run on them
    seed: Count = 0
    seconds: Number | None = None  # of training


@dataclass(frozen=True, config=STRICT)
class Submission:
    """The TOML file."""

    method: Name
    authors: Annotated[list[Words], Field(min_length=1)]
    link: Link  # to a paper, a page or code
    hardware: Words
    profile: Name
    runs: Annotated[list[SubmittedRun], Field(min_length=1)]
    track: Literal["given-poses", "sparse-views"] = "given-poses"


def submit(folder: Path, data: Path, results: Path, overwrite: bool = False) -> list[Record]:
    """Check a submission as a whole, then copy its renders into runs, score them and write the tables.

    Args:
        folder: with `submission.toml` and the renders.
        data: the folder that scenes were built in; there is one below it for the profile.
        results: takes the runs.
        overwrite: replace runs of the same method, scene, pattern and seed.

    Raises:
        InputError: something of it is not as it has to be; then nothing is written. Or a run of that name is there.
    """
    submission = read_submission(folder)
    runs = [_run(submission, one, data, results) for one in submission.runs]
    renders = [checked_renders(folder, run, one) for run, one in zip(runs, submission.runs, strict=True)]
    _refuse_others(folder, [path for paths in renders for path in paths])
    records = []
    try:
        for run, one, paths in zip(runs, submission.runs, renders, strict=True):
            with locked(run.folder, BUSY):
                _adopt(run, submission, one, paths, overwrite)
                records.append(score(run))
    finally:
        if records:
            write_leaderboard(results)
    return records


def read_submission(folder: Path) -> Submission:
    """The TOML file of a submission.

    Raises:
        InputError: there is none, fields are missing, unknown or odd, a run is listed twice, or the name is taken.
    """
    path = folder / ABOUT
    try:
        content = json.dumps(tomllib.loads(as_file(path).read_text("utf-8-sig")), default=str)
        submission = pydantic.TypeAdapter(Submission).validate_json(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be read", found=error.strerror, expected=f"a folder with {ABOUT}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not valid TOML", found=error) from None
    except pydantic.ValidationError as error:
        raise InputError(
            f"{path}: not a submission", found=in_words(error), fix="docs/leaderboard/board.md describes the file"
        ) from None
    if submission.method.casefold() in _taken_names():
        raise InputError(f"{path}: the name {submission.method} is one of ours", fix="choose another name")
    names = [(run.scene, run.pattern, run.seed) for run in submission.runs]
    twice = [name for i, name in enumerate(names) if name in names[:i]]
    if twice:
        raise InputError(f"{path}: a run is listed twice", found=twice[0])
    return submission


def _taken_names() -> set[str]:
    """Folders beside those of methods, and of methods by name or by class, as file systems without case see them."""
    methods = registered(METHODS)
    names = {RAINY_POSES, *methods, *(target.replace(":", ".") for target in methods.values())}
    return {name.casefold() for name in names}


def _run(submission: Submission, one: SubmittedRun, data: Path, results: Path) -> Run:
    """The run that a submitted one becomes, if its scene and pattern are there and the data are the same."""
    built = data / submission.profile
    scenes = read_manifest(built)["scenes"]
    if one.scene not in scenes:
        raise unknown_name(f"{ABOUT}: scene {one.scene} in {built}", one.scene, "scene", scenes)
    folder = built / one.scene
    patterns = [CAPTURED] if is_captured(folder) else [*scenes[one.scene]["patterns"], CLEAN]
    if one.pattern not in patterns:
        raise unknown_name(f"{ABOUT}: pattern {one.pattern} of {one.scene}", one.pattern, "pattern", patterns)
    if not has_clean(folder):
        raise InputError(f"{ABOUT}: {one.scene} has no clean views to compare with")
    expected = data_hash(built, one.scene, one.pattern)
    if one.data_sha256 != expected:
        raise InputError(
            f"{ABOUT}: {one.scene}/{one.pattern} was trained on other data",
            found=f"data_sha256 {one.data_sha256}",
            expected=f"data_sha256 {expected}",
            fix="train on the data set as it is now",
        )
    seed, track = one.seed, submission.track
    return Run(submission.method, submission.profile, seed, built, one.scene, one.pattern, results, track)


def checked_renders(folder: Path, run: Run, one: SubmittedRun) -> list[Path]:
    """The pictures of a run, one for every held-out view and in their order.

    Raises:
        InputError: one is missing, leads out of the folder, or is no 8-bit RGB PNG of the view's size.
    """
    place = folder / one.scene / one.pattern / f"seed-{one.seed}"
    paths = []
    for view in run.clean_scene().test_views:
        path = place / f"{view.name}.png"
        if not path.is_file():
            raise InputError(f"{path}: no render of this held-out view", fix="add it: all of them are scored")
        if path.resolve() != folder.resolve() / path.relative_to(folder):
            raise InputError(f"{path}: a link", found=path.resolve(), expected="a file in the folder itself")
        _check_picture(path, view)
        paths.append(path)
    return paths


def _check_picture(path: Path, view: View) -> None:
    expected = f"an 8-bit RGB PNG of {view.camera.width}x{view.camera.height} pixels, without alpha"
    with path.open("rb") as file:
        if file.read(len(SIGNATURE)) != SIGNATURE:
            raise InputError(f"{path}: no PNG", expected=expected)
    found = pixel_format(read_pixels(path, "a render"))
    if found != render_format(view.camera.width, view.camera.height):
        raise InputError(f"{path}: not as renders are", found=found, expected=expected)


def _refuse_others(folder: Path, renders: Sequence[Path]) -> None:
    """Refuse files that belong to no listed run and no held-out view."""
    others = sorted(set(_files(folder)) - set(renders) - {folder / ABOUT})
    if others:
        raise InputError(
            f"{folder}: files that belong to no run",
            found=some([str(path.relative_to(folder)) for path in others]),
            expected=f"{ABOUT}, and the renders of held-out views of the runs that it lists",
            fix="remove them, or list their runs",
        )


def _files(folder: Path) -> Iterator[Path]:
    """All but the lists that are ours: renders may have been written by our functions."""
    return (path for path in folder.rglob("*") if path.name not in LISTS and (not path.is_dir() or path.is_symlink()))


def _adopt(run: Run, submission: Submission, one: SubmittedRun, renders: Sequence[Path], overwrite: bool) -> None:
    """Make a run's folder of a submitted run: settings, renders, notes, in this order."""
    claim_folder(
        run.folder / CONFIG,
        _settings(run, submission, one, renders),
        taken="holds another run of that name",
        foreign="holds files of unknown origin",
        fix="add --overwrite to replace it, or give the method another name",
        overwrite=overwrite,
    )
    if (run.folder / PREDICTION).is_file():
        return
    for path in renders:
        write_bytes(run.folder / "renders" / path.name, path.read_bytes())
    notes: dict[str, Any] = dict.fromkeys(NOTED)
    notes |= dict.fromkeys(("render_device", "simd", "used", "version"), "")
    write_json(run.folder / PREDICTION, notes | {"train_s": one.seconds, "device": submission.hardware})
    logger.info("%s: submitted by %s", run, ", ".join(submission.authors))


def _settings(run: Run, submission: Submission, one: SubmittedRun, renders: Sequence[Path]) -> dict[str, Any]:
    return {
        "method": run.method,
        "scene": run.scene,
        "pattern": run.pattern,
        "seed": run.seed,
        "profile": run.profile,
        "track": run.track,
        "data_sha256": one.data_sha256,
        "config": {},
        SUBMITTED: {
            "by": ", ".join(submission.authors),
            "link": submission.link,
            "hardware": submission.hardware,
            "seconds": one.seconds,
            "renders_sha256": renders_sha256(renders),
        },
    }
