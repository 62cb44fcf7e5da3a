"""EMG: envelopes recovered from synthetic raw signals, normalisation, files, maps."""

import dataclasses
import json
import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfiltfilt, sosfreqz

from mjhcmc.emg import Emg
from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.io.emg_file import channel_map
from mjhcmc.io.opensim import write_table

RATE = 2000.0


def shape(time, phase=0.0):
    """An envelope between 0 and 1, of 1.5 Hz and its octave: well below the low-pass."""
    return 0.5 + 0.3 * np.sin(2 * np.pi * 1.5 * time + phase) + 0.15 * np.sin(2 * np.pi * 3 * time + 2 * phase)


BAND = (50.0, 250.0)  # Hz, of the synthetic signals: well within what envelopes are made of


def noise(n, rate=RATE, seed=0):
    """(n,) Gaussian, of standard deviation 1, in a band."""
    sos = butter(4, BAND, "bandpass", fs=rate, output="sos")
    white = sosfiltfilt(sos, np.random.default_rng(seed).standard_normal(n))
    return white / white.std()


def raw(seconds=10.0, rate=RATE, phases=(0.0,), volts=1e-4, start=0.0):
    """Raw EMG whose standard deviation is volts * shape."""
    time = np.arange(round(seconds * rate)) / rate
    size = [volts * shape(time, phase) for phase in phases]
    signal = [s * noise(len(time), rate, seed) for seed, s in enumerate(size)]
    return Emg(start + time, np.column_stack(signal), tuple(f"c{i}" for i in range(len(phases))), raw=True)


# --- envelopes ------------------------------------------------------------------------------------------------------


def rms_error(found, expected):
    return float(np.sqrt(np.mean((found - expected) ** 2)) / np.sqrt(np.mean(expected**2)))


def spectrum():
    """Frequencies, Hz, power of the synthetic noise, and of what the envelope's band-pass leaves of it."""
    filters = [butter(4, BAND, "bandpass", fs=RATE, output="sos")]
    filters.append(np.vstack([butter(2, f, kind, fs=RATE, output="sos") for f, kind in ((20, "high"), (450, "low"))]))
    f = sosfreqz(filters[0], 20000, fs=RATE)[0]
    white, passed = (np.abs(sosfreqz(sos, 20000, fs=RATE)[1]) ** 4 for sos in filters)  # each forward and backward
    return f, white, white * passed


def noise_left(lowpass):
    """Relative error of the mean of |Gaussian noise| under a low-pass, by theory.

    cov(|x|, |x'|) = (2/pi) s^2 (sqrt(1 - r^2) + r asin r - 1), about s^2 r^2/pi, over the squared mean 2 s^2/pi: r^2/2.
    The integral of r^2 over all delays is int S^2/(int S)^2 of the two-sided spectrum. The low-pass 1/(1 + (f/fc)^4)
    with fc = f/.802 lets 3 pi/(8 sqrt 2) fc of white noise by, on both sides of 0.
    """
    f, _, power = spectrum()
    correlation = np.sum(power**2) / np.sum(power) ** 2 / (f[1] - f[0]) / 2
    return np.sqrt(0.5 * correlation * 2 * 3 * np.pi / (8 * np.sqrt(2)) * lowpass / 0.802)


@pytest.mark.parametrize("hz", [4.0, 6.0, 12.0])
def test_the_envelope_is_recovered(hz):
    """E|N(0, s)| = sqrt(2/pi) s, to as much noise as theory leaves: 13 % at 6 Hz."""
    emg = raw(60.0)
    found = emg.envelope(lowpass_hz=hz)
    _, whole, passed = spectrum()
    expected = np.sqrt(2 / np.pi * passed.sum() / whole.sum()) * 1e-4 * shape(emg.time)
    inner = slice(1000, -1000)
    value = found.signal[inner, 0]
    smooth = sosfiltfilt(butter(2, hz / 0.802, fs=RATE, output="sos"), expected)[inner]  # what the low-pass may leave
    assert rms_error(value, smooth) == pytest.approx(noise_left(hz), rel=0.2)
    assert np.mean(value) == pytest.approx(np.mean(expected[inner]), rel=0.01)  # no bias
    assert not found.raw
    assert found.scale == "none"
    assert found.signal.min() >= 0


def test_envelopes_are_not_late():
    emg = raw(60.0)
    expected, inner = shape(emg.time), slice(2000, -2000)
    smooth = emg.envelope().signal[inner, 0]
    lags = np.arange(-100, 101, 5)
    r = [np.corrcoef(np.roll(smooth, -lag), expected[inner])[0, 1] for lag in lags]
    assert abs(lags[np.argmax(r)]) / RATE <= 0.01  # s


@given(gain=st.floats(1e-6, 1e3), flip=st.booleans())
@settings(max_examples=10, deadline=None)
def test_envelopes_scale_with_the_signal(gain, flip):
    emg = raw(1.0)
    other = dataclasses.replace(emg, signal=(-gain if flip else gain) * emg.signal)
    np.testing.assert_allclose(other.envelope().signal, gain * emg.envelope().signal, rtol=1e-9, atol=1e-12 * gain)


def test_movement_artefacts_are_filtered_out():
    """A swinging cable, as large as the EMG: the band-pass (20 Hz) lets 1/(1 + (20/8)^4) = 2.5 % of it by."""
    emg = raw(10.0)
    t = emg.time[:, None]
    disturbed = dataclasses.replace(emg, signal=emg.signal + 1e-4 * np.sin(2 * np.pi * 8 * t))
    clean, inner = emg.envelope().signal[500:-500], slice(500, -500)
    assert rms_error(disturbed.envelope().signal[inner], clean) < 0.02
    assert rms_error(disturbed.envelope((6.1, 450.0)).signal[inner], clean) > 0.1  # a lower corner lets it by


def test_an_offset_is_taken_away_and_told_where_it_is_large():
    emg = raw(5.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        small = dataclasses.replace(emg, signal=emg.signal + 1e-5).envelope()
    with pytest.warns(MjhcmcWarning, match=r"channel c0 with an offset that is larger than the signal \(c0: 2.5,"):
        large = dataclasses.replace(emg, signal=emg.signal + 2.5).envelope()
    np.testing.assert_allclose(small.signal, emg.envelope().signal, atol=1e-12)
    np.testing.assert_allclose(large.signal, emg.envelope().signal, atol=1e-9)


def test_gaps_stay_gaps_and_envelopes_beside_them_do_not_sag():
    emg = raw(20.0)
    signal = emg.signal.copy()
    gap = slice(20000, 21000)
    signal[gap] = np.nan
    with pytest.warns(MjhcmcWarning, match=r"c0 with gaps \(c0: 1000 of 40000 samples, first at 10 s\)"):
        found = dataclasses.replace(emg, signal=signal).envelope().signal[:, 0]
    assert np.isnan(found[gap]).all()
    assert np.isfinite(np.delete(found, np.arange(20000, 21000))).all()
    whole = emg.envelope().signal[:, 0]
    for edge in (slice(19900, 20000), slice(21000, 21100)):
        assert np.mean(found[edge]) == pytest.approx(np.mean(whole[edge]), rel=0.25)
    far = np.r_[1000:18000, 23000:39000]
    np.testing.assert_allclose(found[far], whole[far], rtol=0.02)


def test_rows_that_are_missing_are_gaps():
    emg = raw(5.0)
    kept = np.ones(len(emg.time), dtype=bool)
    kept[4000:4400] = False
    with pytest.warns(MjhcmcWarning, match="with gaps"):
        found = Emg(emg.time[kept], emg.signal[kept], ("c0",), raw=True).envelope()
    np.testing.assert_allclose(found.time, emg.time, atol=1e-9)
    assert np.isnan(found.signal[4000:4400]).all()
    assert np.isfinite(found.signal[:4000]).all()


def test_times_that_a_file_rounded_are_even():
    rate = 1925.93
    emg = raw(5.0, rate)
    rounded = dataclasses.replace(emg, time=np.round(emg.time, 4))
    found = rounded.envelope()
    assert found.rate == pytest.approx(rate, rel=1e-5)
    np.testing.assert_allclose(found.signal, emg.envelope().signal, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("when", [lambda t: t + 3e-4 * np.sin(40 * t), lambda t: t**1.05])
def test_uneven_samples_are_refused(when):
    emg = raw(3.0)
    with pytest.raises(MotionError, match=r"samples are not evenly apart \(row \d+ from 0, at .* s, is off by"):
        dataclasses.replace(emg, time=when(emg.time)).envelope()


def test_sampling_too_slow():
    slow = raw(5.0, 150.0 * 4)  # 600 Hz: usable, with less of the band
    with pytest.warns(MjhcmcWarning, match="600 samples a second are fewer than twice 450 Hz.*band ends at 270 Hz"):
        found = slow.envelope()
    assert np.corrcoef(found.signal[100:-100, 0], shape(slow.time[100:-100]))[0, 1] > 0.9
    with pytest.raises(SettingsError, match=r"band ends at 450 Hz, sampling at 600 Hz carries less than 300"):
        slow.envelope((20, 450))
    time = np.arange(200) / 100
    few = Emg(time, np.random.default_rng(0).standard_normal((200, 1)), ("c",), raw=True)
    with pytest.raises(MotionError, match="100 samples a second are too few for raw EMG"):
        few.envelope()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"band": (400, 30)}, "give a lower corner above 0 and an upper one above that"),
        ({"band": (0, 300)}, "give a lower corner above 0"),
        ({"band": 20}, "band must be two corners in Hz"),
        ({"lowpass_hz": 0}, "low-pass cutoff 0 Hz"),
        ({"lowpass_hz": 25.0}, "cutoff 25 Hz is not below the band 20 .. 450 Hz"),
    ],
)
def test_corners_that_make_no_sense(options, message):
    with pytest.raises(SettingsError, match=message):
        raw(1.0).envelope(**options)


def test_a_dead_channel_is_named():
    emg = raw(1.0, phases=(0.0, 1.0))
    signal = emg.signal.copy()
    signal[:, 1] = 0.3
    with pytest.raises(MotionError, match=r"channel 'c1' is constant \(0.3\): a loose electrode"):
        dataclasses.replace(emg, signal=signal).envelope()


def test_raw_and_envelopes_are_told_apart():
    emg = raw(3.0)
    assert Emg(emg.time, emg.signal, ("c",)).raw
    assert Emg(emg.time, emg.signal + 2.5, ("c",)).raw  # an offset is no envelope
    envelope = emg.envelope()
    assert not Emg(envelope.time, envelope.signal, ("c",)).raw
    assert not Emg(emg.time[::50], shape(emg.time[::50])[:, None], ("c",)).raw
    with pytest.raises(SettingsError, match="holds envelopes already"):
        envelope.envelope()
    with pytest.raises(MotionError, match=r"goes down to .*, as no envelope does: mark it as raw"):
        Emg(emg.time, emg.signal, ("c",), raw=False)


# --- normalisation ----------------------------------------------------------------------------------------------------


def test_maximum_contractions_give_the_size():
    envelope = raw(3.0, phases=(0.0, 1.0)).envelope()
    found = envelope.normalised({"c0": 2e-4, "c1": 4e-4})
    np.testing.assert_allclose(found.signal, envelope.signal / [2e-4, 4e-4])
    assert found.scale == "mvc"
    np.testing.assert_allclose(envelope.normalised(2e-4).signal, envelope.signal / 2e-4)


def test_own_peak_and_percentile():
    envelope = raw(3.0, phases=(0.0, 1.0)).envelope()
    assert envelope.normalised().signal.max(axis=0) == pytest.approx([1, 1])
    assert envelope.normalised().scale == "peak"
    found = envelope.normalised(percentile=95)
    assert found.scale == "percentile 95"
    assert (found.signal > 1).mean(axis=0) == pytest.approx([0.05, 0.05], abs=0.001)


def test_a_maximum_that_is_none_is_told():
    envelope = raw(3.0).envelope()
    with pytest.warns(MjhcmcWarning, match=r"channel 'c0' rises to .* of its maximum contraction"):
        envelope.normalised(0.5 * envelope.signal.max())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mvc": {"c0": 1.0, "x": 2.0, "c1": 1.0}}, "mvc names x, which it has not.*channels c0, c1"),
        ({"mvc": {"c0": 1.0}}, "mvc lacks c1"),
        ({"mvc": {"c0": 1.0, "c1": 0.0}}, "mvc of c1 must be a positive number; got 0.0"),
        ({"mvc": {"c0": 1.0, "c1": "much"}}, "mvc of c1 must be a positive number; got 'much'"),
        ({"percentile": 0}, "percentile must be above 0"),
    ],
)
def test_values_that_are_no_maxima(options, message):
    with pytest.raises(SettingsError, match=message):
        raw(1.0, phases=(0.0, 1.0)).envelope().normalised(**options)


def test_raw_signals_are_not_normalised_or_interpolated():
    for use in (Emg.normalised, lambda emg: emg.at(np.zeros(1))):
        with pytest.raises(SettingsError, match="is raw: take its envelope first"):
            use(raw(1.0))


# --- data and files ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"channels": ("c0",)}, r"time has shape \(2000,\) and signal \(2000, 2\) with 1 channels"),
        ({"channels": ("a", "a")}, "channel 'a' stands twice"),
        ({"time": np.zeros(2000)}, "row 1 .from 0.: time 0 s follows 0 s: times must increase"),
        ({"signal": np.full((2000, 2), "x")}, "signal must hold numbers"),
        ({"signal": np.column_stack([np.ones(2000), np.full(2000, np.nan)])}, "channel 'c1' holds no value"),
        ({"signal": np.full((2000, 2), np.inf)}, "channel 'c0' is infinite at 0 s"),
    ],
)
def test_data_that_cannot_be(change, message):
    with pytest.raises(MotionError, match=message):
        dataclasses.replace(raw(1.0, phases=(0.0, 1.0)), **change)


@pytest.mark.parametrize("suffix", [".csv", ".sto", ".mot", ".parquet"])
def test_files(tmp_path, suffix):
    emg = raw(1.0, phases=(0.0, 1.0), start=3.0)
    path = tmp_path / f"trial{suffix}"
    table = pd.DataFrame({"time": emg.time, "c0": emg.signal[:, 0], "c1": emg.signal[:, 1]})
    if suffix == ".csv":
        table.to_csv(path, index=False)
    elif suffix == ".parquet":
        table.to_parquet(path)
    else:
        write_table(path, ["c0", "c1"], emg.time, emg.signal, name="EMG", in_degrees=False)
    found = Emg.from_file(path)
    np.testing.assert_array_equal(found.time, emg.time)
    np.testing.assert_array_equal(found.signal, emg.signal)
    assert found.channels == ("c0", "c1")
    assert found.raw
    assert found.name == str(path)
    assert Emg.from_file(path, ["c1"]).channels == ("c1",)
    with pytest.raises(MotionError, match=r"no column 'c2': its columns are c0, c1"):
        Emg.from_file(path, ["c2"])


def test_an_empty_cell_is_a_gap(tmp_path):
    path = tmp_path / "gap.csv"
    path.write_text("time,vasti\n" + "".join(f"{0.1 * k:.1f},{'' if k == 3 else k}\n" for k in range(6)))
    assert np.isnan(Emg.from_file(path).signal[3, 0])
    assert Emg.from_file(path).at(np.array([0.05, 0.31, 0.9]))[:, 0] == pytest.approx(
        [0.5, np.nan, np.nan], nan_ok=True
    )


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", "x", "ends in .csv, .mot, .sto, .parquet, not in '.txt'"),
        ("a.csv", "t,c\n0,1\n", "no column 'time'"),
        ("a.csv", "time\n0\n1\n2\n3\n", "no column beside time"),
        ("a.csv", "time,c\n0,1\n,2\n2,3\n3,1\n", r"time is not finite in row 1"),
        ("a.parquet", "PAR1", "cannot be read as .parquet"),
    ],
)
def test_files_that_cannot_be(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(MotionError, match=message) as caught:
        Emg.from_file(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_no_such_file(tmp_path):
    for name in ("none.csv", "none.parquet"):
        with pytest.raises(MotionError, match="no such file"):
            Emg.from_file(tmp_path / name)


def test_cropped_shifted_and_only():
    emg = raw(1.0, phases=(0.0, 1.0))
    part = emg.cropped(0.25, 0.5)
    assert (part.time[0], part.time[-1]) == (0.25, 0.5)
    assert part.shifted(1.5).time[0] == 1.75
    np.testing.assert_array_equal(emg.only(["c1"]).signal[:, 0], emg.signal[:, 1])
    with pytest.raises(SettingsError, match="between 5 and 6 s there are 0 samples"):
        emg.cropped(5, 6)
    with pytest.raises(SettingsError, match="no channel 'c7': its channels are c0, c1"):
        emg.only(["c7"])


MUSCLES, CHANNELS = ("psoas", "vas_lat", "vas_med", "soleus"), ("VL", "SOL", "psoas")


def test_maps(tmp_path):
    wanted = {"vas_lat": "VL", "vas_med": "VL", "soleus": "SOL"}  # one channel serves two muscles
    table = tmp_path / "map.csv"
    table.write_text("muscle,channel\nsoleus,SOL\n# by the lab\nvas_med,VL\nvas_lat,VL\n")
    (tmp_path / "map.json").write_text(json.dumps(wanted))
    for given_map in (wanted, table, tmp_path / "map.json", str(table)):
        found = channel_map(given_map, MUSCLES, CHANNELS)
        assert found == wanted
        assert list(found) == ["vas_lat", "vas_med", "soleus"]  # the model's order
    assert channel_map(None, MUSCLES, CHANNELS) == {"psoas": "psoas"}


@pytest.mark.parametrize(
    ("given_map", "message"),
    [
        (
            {"vasti": "VL", "gluteus": "SOL"},
            r"no muscles vasti, gluteus: the muscles are psoas, vas_lat, vas_med, soleus",
        ),
        ({"soleus": "SO", "psoas": "P"}, r"no channels SO, P: the channels are VL, SOL, psoas"),
        ({"VL": "vas_lat"}, "turned round: it maps channels to muscles"),
        ({}, r"no muscle is measured: map the muscles \(psoas"),
    ],
)
def test_maps_of_what_is_not_there(given_map, message):
    with pytest.raises(SettingsError, match=message):
        channel_map(given_map, MUSCLES, CHANNELS)


def test_no_channel_has_a_muscles_name():
    with pytest.raises(SettingsError, match="no muscle is measured"):
        channel_map(None, MUSCLES, ("VL",))
