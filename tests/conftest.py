import sys
from pathlib import Path

# Not tests/ itself: it has folders named like the packages.
sys.path.insert(0, str(Path(__file__).parent / "helpers"))
