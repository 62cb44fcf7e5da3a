"""A periodic movement out of noisy cycles."""

import numpy as np
import pytest

import mjhcmc


def wave(time, period=0.5):
    phase = 2 * np.pi * time / period
    return np.stack([0.3 + 0.2 * np.cos(phase) + 0.1 * np.sin(2 * phase), 0.4 * np.sin(phase)], axis=1)


def test_a_series_is_found_again():
    time = np.sort(np.random.default_rng(0).uniform(1.0, 4.0, 90))  # any times
    found = mjhcmc.fit_harmonics(mjhcmc.Motion(time, wave(time - time[0])), 0.5, 2)
    at = np.linspace(found.start, found.end, 77)
    assert np.abs(found.sample(at).qpos - wave(at - time[0])).max() < 1e-7
    assert found.duration == pytest.approx(time[-1] - time[0])


def test_noise_falls_with_the_number_of_samples():
    """The error's variance is 5 coefficients of m samples: sqrt(5/m) of the noise."""
    rng, noise = np.random.default_rng(1), 0.02
    errors = []
    for m in (100, 1600):
        left = []
        for _ in range(20):
            time = np.linspace(0.0, 5.0, m + 1)
            seen = mjhcmc.Motion(time, wave(time) + noise * rng.standard_normal((m + 1, 2)))
            found = mjhcmc.fit_harmonics(seen, 0.5, 2, cycles=1)
            left.append(found.qpos - wave(found.time))
        errors.append(np.sqrt(np.mean(np.square(left))))
    assert errors == pytest.approx([noise * np.sqrt(5 / 101), noise * np.sqrt(5 / 1601)], rel=0.15)


def test_cycles_are_as_many_as_asked():
    time = np.linspace(0.0, 2.0, 201)
    found = mjhcmc.fit_harmonics(mjhcmc.Motion(time, wave(time)), 0.5, 2, cycles=3)
    assert found.duration == pytest.approx(1.5)
    assert "2 harmonics of 0.5 s" in found.notices


@pytest.mark.parametrize(
    ("arguments", "error", "told"),
    [
        ((0.0, 1), mjhcmc.SettingsError, "period"),
        ((0.5, 0), mjhcmc.SettingsError, "harmonics"),
        ((0.5, 1, 0), mjhcmc.SettingsError, "cycles"),
        ((3.0, 1), mjhcmc.MotionError, "measure longer"),
        ((0.5, 60), mjhcmc.SettingsError, "too few"),
    ],
)
def test_what_cannot_be_fitted_is_refused(arguments, error, told):
    time = np.linspace(0.0, 2.0, 201)
    with pytest.raises(error, match=told):
        mjhcmc.fit_harmonics(mjhcmc.Motion(time, wave(time)), *arguments)
