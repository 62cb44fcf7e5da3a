"""What a test cannot do without: where it is missing the test is skipped, but not where it was installed on purpose."""

import os
from typing import NoReturn

import pytest


def missing(why: str) -> NoReturn:
    """Skip with a reason; fail where MJHCMC_REQUIRE_BROWSER says that browser, screen and OpenGL are there."""
    if os.environ.get("MJHCMC_REQUIRE_BROWSER"):
        pytest.fail(why)
    pytest.skip(why)
