"""Makes `reports` importable, and the fixtures of `ros_bench`: domain, nodes, counterpart."""

from ros_bench import domain, start, world

__all__ = ["domain", "start", "world"]
