"""Videos of trained scenes: camera paths and frames."""
