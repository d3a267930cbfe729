"""Errors on held-out photographs in known rain: pictures.py draws them, scores.py judges a network on them;
detection.py judges covers, calibration.py predicted errors."""
