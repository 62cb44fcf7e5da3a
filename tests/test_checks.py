"""What counts as a number among settings."""

import numpy as np
import pytest

from mjhcmc.checks import is_number


@pytest.mark.parametrize("value", [0, -1, 2.5, np.float32(1), np.int8(3), np.float64("nan"), float("inf")])
def test_numbers(value):
    assert is_number(value)


@pytest.mark.parametrize("value", [True, np.True_, None, "1", [1], np.ones(1), 1j, 10 + 0j])
def test_no_numbers(value):
    assert not is_number(value)
