"""How an enhancement network is trained, beside what all networks from pairs share."""

from dataclasses import dataclass

from baselines.supervised.config import SupervisedConfig
from deraings.enhancement.architecture.network import SMALL, NetworkConfig


@dataclass(frozen=True, kw_only=True)
class TrainingConfig(SupervisedConfig):
    """The network, and the weights of its losses beside that of the picture; see `loss`."""

    network: NetworkConfig = SMALL
    frequency: float = 3.0  # weight of the loss in Fourier coefficients
    lifting: float = 0.5  # weight of the mist's own loss, if the network has a mist branch
    detection: float = 0.5  # weight of the loss of the cover, if the network predicts it
    doubt: float = 0.1  # weight of the loss of the predicted error, if the network predicts it
