"""Settings that all trainings of scenes share."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class SessionConfig:
    """The device of a training and the interval of its checkpoints; neither changes the result."""

    device: str = "auto"  # auto, cpu or cuda; $HYDROVIEWS_DEVICE takes precedence
    checkpoint_seconds: float = 30.0  # seconds of training between two checkpoints
