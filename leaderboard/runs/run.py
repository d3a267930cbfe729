"""Where a run keeps its files, and the settings that make it that run.

<results>/<profile>/<method>/<scene>/<pattern>/seed-<n>/    in the track sparse-views: seed-<n>-sparse-views, and so on
    config.json      settings, data hash
    sessions.json    every start of the training, see `leaderboard.runs.sessions`
    renders/*.png    held-out views, written before any metric is computed
    prediction.json  time, memory, size
    per_view.csv, record.json, preview.png
    and what the method saves: model, checkpoint, splats.ply
"""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from baselines.method import find_method
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.lending import Loan, lend
from hydroviews.dataset.manifest import data_hash, known_file, read_manifest
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files import settings_guard
from hydroviews.files.atomic import read_json
from hydroviews.scene.scenes import Scene
from leaderboard.records import GIVEN_POSES, RAINY_POSES, SPARSE_VIEWS, check_track, effect_of, run_folder
from leaderboard.runs.estimated_cameras import Estimate, estimate_cameras, with_cameras
from leaderboard.runs.plain_settings import plain_settings
from leaderboard.runs.sessions import CONFIG


@dataclass(frozen=True)
class Run:
    """One method on one variant of one scene."""

    method: str
    profile: str
    seed: int
    data: Path  # the folder with the manifest
    scene: str
    pattern: str  # a variant's name, or "clean"
    results: Path
    track: str = GIVEN_POSES

    def __post_init__(self) -> None:
        check_track(self.track)

    @property
    def folder(self) -> Path:
        """Where the run's files go."""
        return run_folder(self.results, self.profile, self.method, self.scene, self.pattern, self.seed, self.track)

    @property
    def cameras(self) -> Path:
        """Where the cameras of the track rainy-poses are: see `estimated_cameras`."""
        return self.results / self.profile / RAINY_POSES / self.scene / self.pattern / f"seed-{self.seed}"

    @property
    def effect(self) -> str:
        """raindrop, streak, storm, captured or clean."""
        return effect_of(self.pattern)

    def __str__(self) -> str:
        track = "" if self.track == GIVEN_POSES else f", {self.track}"
        return f"{self.method} on {self.scene}/{self.pattern}, seed {self.seed}{track}"

    def training_scene(self) -> Scene:
        """The scene whose training photographs the method is shown."""
        return self.on_track(self.given_scene())

    def given_scene(self) -> Scene:
        """The same as it was built, whatever the track."""
        folder = self.data / self.scene
        return open_clean(folder) if self.pattern == CLEAN else open_variant(folder, self.pattern)

    def clean_scene(self) -> Scene:
        """The clean views, with what this run's track trains on and holds out."""
        return self.on_track(open_clean(self.data / self.scene))

    @contextmanager
    def lent(self) -> "Iterator[tuple[Run, Loan]]":
        """The run on a data folder with no more in it than its method may see, until the block ends.

        Raises:
            InputError: the scene is not finished, or a file is not what the manifest says.
        """
        scene = self.training_scene()
        train = set(scene.split.train)
        held_back = [view.name for view in scene.views if view.name not in train]
        cameras = self.cameras if self.track == RAINY_POSES else None
        with lend(self.data / self.scene, self.pattern, train, held_back, self.folder, cameras) as loan:
            yield dataclasses.replace(self, data=loan.data), loan

    def on_track(self, scene: Scene) -> Scene:
        """The scene with the training views, and their cameras, of this run's track.

        Raises:
            InputError: cameras have not been estimated, or too few to train on.
        """
        if self.track == RAINY_POSES:
            return with_cameras(scene, self.cameras)
        return scene.sparse() if self.track == SPARSE_VIEWS else scene

    def estimate(self) -> Estimate:
        """Estimate the cameras of the track rainy-poses, unless another run has."""
        digest = data_hash(self.data, self.scene, self.pattern)
        return estimate_cameras(self.cameras, self.given_scene(), self.seed, digest, rainy=self.pattern != CLEAN)

    def drawing_code(self) -> str:
        """Digest of the code that drew what the method is shown; empty where it was photographed, or never recorded.

        Raises:
            InputError: `pattern.json` is not what the manifest says.
        """
        made = read_manifest(self.data)["scenes"][self.scene]
        if self.pattern != CLEAN:
            made = read_json(known_file(self.data / self.scene, f"{self.pattern}/pattern.json"))
        return str(made.get("drawing_code", ""))

    def settings(self) -> dict[str, Any]:
        """Everything that fixes the result; a run with other settings is another run."""
        return {
            "method": self.method,
            "scene": self.scene,
            "pattern": self.pattern,
            "seed": self.seed,
            "profile": self.profile,
            "track": self.track,
            "data_sha256": data_hash(self.data, self.scene, self.pattern),
            "config": recorded_configuration(self.method, self.profile),
        }


def refuse_other_data(run: Run, fix: str) -> None:
    """Compare the data that a run was made with, as its `config.json` says, with what lies there now.

    Raises:
        InputError: the scene is not there, or has changed since.
    """
    then = read_json(run.folder / CONFIG).get("data_sha256")
    listed = run.scene in read_manifest(run.data)["scenes"]
    now = data_hash(run.data, run.scene, run.pattern) if listed else None
    if now != then:
        raise InputError(
            f"{run}: {run.data} has not the data that it was run on",
            found=f"data_sha256 {now}" if listed else f"no finished scene {run.scene}",
            expected=f"data_sha256 {then}",
            fix=fix,
        )


def claim_folder(run: Run, overwrite: bool) -> None:
    """Make the run's folder its own. A run with the same settings is resumed, overwriting or not.

    Raises:
        InputError: it holds a run with other settings and `overwrite` is not asked for, or files of unknown origin.
    """
    settings_guard.claim_folder(
        run.folder / CONFIG,
        run.settings(),
        taken="holds a run with other settings",
        foreign="holds files of a run with other settings, or of none",
        fix="add --overwrite (make eval OVERWRITE=1) to run it anew, or choose another results folder",
        overwrite=overwrite,
    )


def has_settings(run: Run) -> bool:
    """Whether a run's folder holds a run with today's settings and data."""
    return settings_guard.has_settings(run.folder / CONFIG, run.settings())


def recorded_configuration(method: str, profile: str) -> Any:
    """A method's settings for a profile, as a run's `config.json` has them.

    Raises:
        InputError: there is no such method or profile, or what the method gives for it cannot be recorded.
    """
    kind = find_method(method)
    try:
        config = kind.configuration(profile)
    except InputError:
        raise
    except Exception as error:  # whatever a method does
        found = f"{type(error).__name__}: {error}"
        raise InputError(f"METHOD={method}: no configuration for PROFILE={profile}", found=found) from error
    return as_json(method, config)


def as_json(method: str, config: Any) -> dict[str, Any]:
    """A configuration as it comes back from a JSON file.

    Raises:
        InputError: it is not a dataclass of plain values; it names the field.
    """
    try:
        return plain_settings(config)
    except (AttributeError, TypeError, ValueError) as error:  # the first for a field without a value
        raise InputError(
            f"METHOD={method}: its configuration cannot be recorded",
            found=error,
            fix="keep what is no plain value out of the dataclass: make it in `fit` from plain settings",
        ) from error
