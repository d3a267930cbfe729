"""Networks that look at photographs, for methods that make colours or masks of what they show.

    frozen.py            frozen features by name: DINOv2, AlexNet, VGG
    dinov2.py            DINOv2's first blocks, in torch
    unet.py              U-Nets on ResNet-18 or a small backbone, with a decoder for a visibility mask
    resnet_weights.py    ResNet-18 weights from a file that the user names
    config.py            settings of encoders that learn with the scene
    appearance.py        colours by view from the view's own photograph, encoded anew in every step
    objective.py         the loss of methods with such colours
    sampling.py          reads of feature maps at points

Frozen features never change; U-Nets learn with the scene.
"""
