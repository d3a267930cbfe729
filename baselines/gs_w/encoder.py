"""The U-Net that looks at the reference picture: feature maps and a visibility mask (GS-W)."""

from torch import Tensor, nn

from baselines.encoders.unet import PictureEncoder, Up, visibility, visibility_decoder


class ReferenceEncoder(PictureEncoder):
    """Feature maps and visibility of a reference picture."""

    def __init__(self, backbone: str, outputs: int) -> None:
        super().__init__(backbone)
        widths, finest = self.backbone.widths, self.backbone.finest
        steps = [(widths[k + 1], widths[k]) for k in reversed(range(finest, len(widths) - 1))]
        convolutions = 1 if backbone == "small" else 2
        self.ups = nn.ModuleList(Up(deep, skip, skip, convolutions) for deep, skip in steps)
        self.head = nn.Conv2d(widths[finest], outputs, 1)
        self.lifts, self.visible = visibility_decoder(self.backbone)

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor]:
        """Maps [outputs, h, w] at 1/4 (small) or 1/2 of the picture, and m [h, w] in (0, 1) at 1/4 of it."""
        levels = self.backbone(picture)
        x = levels[-1]
        for up, skip in zip(self.ups, reversed(levels[-1 - len(self.ups) : -1]), strict=True):
            x = up(x, skip)
        return self.head(x)[0], visibility(self.lifts, self.visible, levels[-1])
