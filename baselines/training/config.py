"""Settings that all trainings of scenes share."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class SessionConfig:
    """Where a scene is trained, and how often its state is written; both leave the result as it is."""

    device: str = "auto"  # auto, cpu or cuda; $HYDROVIEWS_DEVICE takes precedence
    checkpoint_seconds: float = 30.0  # seconds of training between two checkpoints
