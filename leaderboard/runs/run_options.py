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
    """Of all runs of a command."""

    patterns: PatternNames = ()  # 0 is light, 1 medium, 2 heavy; the profile's patterns if none is named
    profile: ProfileName = "demo"
    track: TrackName = GIVEN_POSES  # or sparse-views: a third of the training views; rainy-poses: estimated cameras
    data: Path = Path("data")
    results: Path = Path("results")
    captures: Path | None = None  # the folder with published captures; $HYDROVIEWS_CAPTURES if not given
    time_limit: float = WEEK  # hours that a run may take in all, each time it is tried
    stall_limit: float = 1.0  # hours that a run may take without a line printed or a file written
    memory_limit: float | None = None  # 10^9 bytes that a run's process may have to itself; what there is if not given

    @property
    def limits(self) -> Limits:
        """What the process of each run may take.

        Raises:
            InputError: a limit that is not above 0.
        """
        return Limits(self.time_limit, self.stall_limit, self.memory_limit)
