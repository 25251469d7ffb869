"""The command line in this process; processes that a test starts, and none of them after it."""

from command_bench import refused, tombo
from suite_bench import marked

__all__ = ["marked", "refused", "tombo"]
