"""Makes `tiny_node` importable, and the fixtures of `ros_bench`: domain, nodes, counterpart."""

import sys
from pathlib import Path

from ros_bench import domain, start, world

sys.path.insert(0, str(Path(__file__).parent))

__all__ = ["domain", "start", "world"]
