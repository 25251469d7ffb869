"""The version of the suite, for `tombo --version` and summaries."""

from __future__ import annotations


def tombo_version() -> str:
    """Return the installed version, or "unknown" when run from sources that are not installed."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("tombo_bringup")
    except PackageNotFoundError:
        return "unknown"
