"""What is wrong with a log before any physics is asked: see `check_log`."""

from tombo_diagnosis.checks.pipeline import check_log

__all__ = ["check_log"]
