"""Checks of a log before the diagnosis: see `check_log`."""

from tombo_logs.checks.pipeline import check_log, findings_of

__all__ = ["check_log", "findings_of"]
