from undisturbed_training import finished, undisturbed  # noqa: F401
