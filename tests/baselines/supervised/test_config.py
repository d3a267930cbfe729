"""Numbers on command lines that no training can have."""

import math

import pytest

from baselines.derain_nerf.raindrop_attention.config import TrainingConfig as AttentionConfig
from baselines.supervised.commands import use_threads
from baselines.supervised.config import Intervals
from deraings.enhancement.training.config import TrainingConfig
from hydroviews.errors import InputError


@pytest.mark.parametrize("config", [TrainingConfig, AttentionConfig])
@pytest.mark.parametrize(
    "wrong", [{"steps": 0}, {"steps": -1}, {"seed": -1}, {"batch": 0}, {"rate": math.nan}, {"rate": -1e-3}]
)
def test_numbers_that_no_training_can_have(config, wrong):
    ((name, value),) = wrong.items()
    with pytest.raises(InputError, match=f"--{name} {value}: impossible"):
        config(**wrong)


def test_intervals_and_threads():
    with pytest.raises(InputError, match="--checkpoint-seconds inf: impossible"):
        Intervals(checkpoint_seconds=math.inf)
    with pytest.raises(InputError, match="--validate-every 0: impossible"):
        Intervals(validate_every=0)
    with pytest.raises(InputError, match="--threads -1: impossible"):
        use_threads(-1)
