"""The data card of a built scene, and its contact sheets."""
