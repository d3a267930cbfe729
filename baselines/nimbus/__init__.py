"""NimbusGS: what lies between a camera and the scene, in part a medium in space, in part a picture of each view."""
