"""The data card of a built scene."""
