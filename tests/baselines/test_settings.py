"""Settings with which no method could train are refused when they are made."""

import pytest

from baselines.cr_nerf.config import CrNerfConfig, StyleConfig, TransformConfig, TransientConfig
from baselines.gs_w.config import ReferenceConfig
from baselines.ha_nerf.config import LookConfig
from baselines.masking.feature_network import MaskNetworkConfig
from baselines.masking.rays import PriceConfig
from baselines.masking.trimmed import TrimConfig
from baselines.nimbus.config import MediumConfig, ResidualConfig
from baselines.occ_nerf.config import OccNerfConfig
from baselines.splatting.config import TrainerConfig
from baselines.volumetric.config import MlpFieldConfig
from baselines.wild_gs.config import LookConfig as WildLookConfig
from deraings.masks.config import MaskConfig

WRONG = {
    CrNerfConfig: [{"transform": TransformConfig(size=65)}],
    StyleConfig: [{"mean_share": 1.5}, {"channels": (4, 4)}, {"side": 7}],
    TransientConfig: [{"dilations": (1, 0)}, {"dilations": (1, 4), "side": 9}, {"at_first": 1.0}],
    MaskNetworkConfig: [{"prior": 0}, {"prior": 1}],
    TrimConfig: [{"inlier_share": 0}, {"inlier_share": 1.1}, {"fade_in": 0}],
    ReferenceConfig: [{"maps": 0}, {"visible_price": 0}],
    LookConfig: [{"mean_share": 1.5}, {"channels": (4,)}, {"channels": (4, 4, 4, 4), "side": 7}],
    MediumConfig: [{"cells": 1}, {"judged": 2}, {"first": 0.5}, {"renewed": 0}, {"variation": -1}],
    ResidualConfig: [{"threshold": 0}, {"first": 2}, {"every": -1}],
    OccNerfConfig: [{"gap": 0.0}, {"gap": 1.0}, {"alone": 1.0}, {"alone": -0.1}, {"background": MlpFieldConfig()}],
    TrainerConfig: [
        *({"dense_start": share} for share in (-0.1, 1.5)),
        *({"resolutions": steps} for steps in (((0.6, 4), (0.6, 2)), ((0.0, 2),), ((0.5, 0),))),
    ],
    MaskConfig: [{"start": 0}, {"every": 0}, {"regularisation": 0}],
    PriceConfig: [{"at_first": 0.0}, {"price": 0.0}, {"typical": "mode"}],
    WildLookConfig: [{"side": 30}, {"box": 0.0}, {"rate_networks": 0.0}, {"code": 0}, {"absent": 1.0}, {"shrink": 0}],
}


@pytest.mark.parametrize(("settings", "changes"), [(kind, changes) for kind in WRONG for changes in WRONG[kind]])
def test_settings_that_make_no_sense_are_refused(settings, changes):
    settings()
    with pytest.raises(ValueError, match=r"expected|must be|at_first|price|matrices|shares|schedule|regularisation"):
        settings(**changes)
