"""The network that looks at the reference picture as a whole: its global features and what is visible (Wild-GS)."""

from torch import Tensor

from baselines.encoders.unet import PictureEncoder, visibility, visibility_decoder


class LookEncoder(PictureEncoder):
    """Mean features of a picture, and its visibility mask; pictures are as for GS-W's encoder."""

    def __init__(self, backbone: str) -> None:
        super().__init__(backbone)
        self.outputs = self.backbone.widths[-1]
        self.lifts, self.visible = visibility_decoder(self.backbone)

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor]:
        """[1, 3, H, W] to features [outputs] and m [H / 4, W / 4] in (0, 1)."""
        coarsest = self.backbone(picture)[-1]
        return coarsest.mean(dim=(0, 2, 3)), visibility(self.lifts, self.visible, coarsest)
