"""What evaluations and sweeps have in common: where runs read and write, and what they may take."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from baselines.method import METHODS
from hydroviews.cli.commands import choices
from hydroviews.cli.plugins import registered
from hydroviews.profiles import PROFILES
from hydroviews.rain.registry import pattern_names
from leaderboard.records import GIVEN_POSES, TRACKS
from leaderboard.runs.supervision import Limits

WEEK = 168.0  # hours

MethodName = Annotated[str, choices(registered(METHODS), "package.module:Class")]
ProfileName = Annotated[str, choices(PROFILES)]
TrackName = Annotated[str, choices(TRACKS)]
PatternNames = Annotated[tuple[str, ...], choices(pattern_names(), "package.module:Class-0")]


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of all runs of a command."""

    patterns: PatternNames = ()  # effects with a grade: 0 light, 1 medium, 2 heavy. Default: the profile's
    profile: ProfileName = "demo"
    track: TrackName = GIVEN_POSES  # sparse-views: a third of the training views; rainy-poses: estimated cameras
    data: Path = Path("data")
    results: Path = Path("results")
    captures: Path | None = None  # the folder with captures. Default: $HYDROVIEWS_CAPTURES
    time_limit: float = WEEK  # hours per run and attempt
    stall_limit: float = 1.0  # hours without output or a written file, after which a run fails
    memory_limit: float | None = None  # memory per run, GB. Default: unlimited

    @property
    def limits(self) -> Limits:
        """What the process of each run may take.

        Raises:
            InputError: a limit that is not above 0.
        """
        return Limits(self.time_limit, self.stall_limit, self.memory_limit)
