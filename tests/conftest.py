"""Makes `ros_bench` importable: test folders are no packages. Remembers which test has failed."""

import pytest

from ros_bench import FAILED


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.failed:
        item.stash[FAILED] = True
    return report
