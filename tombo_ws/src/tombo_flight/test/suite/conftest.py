"""Makes the bench importable; processes that a test starts, and none of them after it."""

from suite_bench import marked

__all__ = ["marked"]
