"""Motions from files: degrees, radians and metres, and the joints' ranges."""

import re
from dataclasses import replace

import numpy as np
import pytest
from motion_tools import CART, DATA, DEG, LEG, TIME, measured

from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.motion import Motion


def test_a_walk_in_radians_called_degrees_is_a_warning(write):
    time, angles = measured()
    with pytest.warns(MjhcmcWarning, match=r"inDegrees=yes but no angle exceeds 1\.\d+, which looks like radians"):
        Motion.from_file(write(time, angles * DEG), LEG)


@pytest.mark.parametrize("amplitude", [20, 5, 2])
def test_small_movements_in_degrees_are_no_radians(write, amplitude):
    wave = amplitude / 2 * (1 - np.cos(2 * np.pi * TIME))[:, None] * [0.5, -1, -0.5]
    Motion.from_file(write(TIME, wave), LEG)


def test_a_joint_held_still_is_no_radians(write):
    Motion.from_file(write(TIME, np.zeros((21, 3))), LEG)


def test_degrees_called_radians(write):
    time, angles = measured()
    path = write(time, angles, in_degrees=False)
    with pytest.raises(MotionError, match=r"joint knee .*inDegrees=no but angles reach 69\.4, .*like degrees"):
        Motion.from_file(path, LEG)
    free = replace(LEG, joint_range=np.full((3, 2), [-np.inf, np.inf]))
    with pytest.warns(MjhcmcWarning, match=r"which looks like degrees: if they are, write inDegrees=yes"):
        Motion.from_file(path, free)
    with pytest.raises(MotionError, match=r"as degrees the angles would fit: if they are, write inDegrees=yes"):
        Motion.from_file(write(TIME, DATA / 4, in_degrees=False), LEG)
    Motion.from_file(write(time, angles * DEG, in_degrees=False), LEG)


def test_out_of_range_names_joint_time_value_and_range(write):
    values = DATA.copy()
    values[10, 1] = 10 + 1e-6
    with pytest.raises(MotionError) as raised:
        Motion.from_file(write(TIME, values), LEG)
    assert re.search(
        r"m\.mot: joint knee is at 10\.000001 deg at 0\.5 s, outside its range -120 \.\. 10 deg in model leg: ",
        str(raised.value),
    )
    assert "inDegrees" not in str(raised.value)


def test_a_joint_may_rest_at_its_limit(write):
    knee = 10 + 1e-8 - 40 * (TIME - 0.5) ** 2  # 1e-8 deg is under the 1e-9 rad let pass
    motion = Motion.from_file(write(TIME, np.column_stack([0 * TIME, knee, 0 * TIME])), LEG)
    assert motion.sample(0.5).qpos[0, 1] == pytest.approx(10 * DEG)


def test_slides_are_judged_in_metres(write):
    values = np.column_stack([1.5 * TIME, TIME])
    with pytest.raises(MotionError, match=r"joint rail is at 1\.5 m at 1 s, outside its range -1 \.\. 1 m"):
        Motion.from_file(write(TIME, values, CART.joint_names, in_degrees=False), CART)


def test_the_spline_between_the_rows_is_judged_too(write):
    """Rows that all stay within the range, and a spline that leaves it between them."""
    knee = np.array([-60.0, -60, -60, 10, 10, -60, -60, -60])
    time = np.arange(8.0)
    values = np.column_stack([0 * knee, knee, 0 * knee])
    with pytest.raises(MotionError, match=r"spline between its rows: joint knee is at [12]\d\.\d+ deg at 3\.5 s"):
        Motion.from_file(write(time, values), LEG)


def test_only_the_crop_is_judged(write):
    values = np.column_stack([0 * TIME, 20 * TIME, 0 * TIME])
    Motion.from_file(write(TIME, values), LEG, end=0.5)
    with pytest.raises(MotionError, match="joint knee is at 20 deg at 1 s"):
        Motion.from_file(write(TIME, values), LEG)


def test_a_header_without_in_degrees_needs_the_unit_from_elsewhere(write):
    path = write(TIME, DATA)
    path.write_text(path.read_text().replace("inDegrees=yes\n", ""))
    with pytest.raises(
        MotionError, match=r"m\.mot: .*add the line inDegrees=yes .*before endheader, or give angle_unit"
    ):
        Motion.from_file(path, LEG)
    np.testing.assert_array_equal(Motion.from_file(path, LEG, angle_unit="deg").qpos, DATA * DEG)
    path = write(TIME, DATA * DEG, in_degrees=False)
    np.testing.assert_array_equal(Motion.from_file(path, LEG, angle_unit="rad").qpos, DATA * DEG)


def test_an_angle_unit_that_contradicts_the_file_is_refused(write):
    with pytest.raises(
        MotionError, match=r"m\.mot: the header says inDegrees=yes but angle_unit says rad: leave angle"
    ):
        Motion.from_file(write(TIME, DATA), LEG, angle_unit="rad")


@pytest.mark.parametrize("options", [{"angle_unit": "degrees"}, {"angle_unit": ""}, {"angles": "limb"}])
def test_unknown_units_and_angles(write, options):
    with pytest.raises(SettingsError, match=r"angle_unit '.*': choose 'deg' or 'rad'|angles 'limb': choose 'joint' or"):
        Motion.from_file(write(TIME, DATA), LEG, **options)


def test_no_hint_at_degrees_that_would_not_fit_either(write):
    narrow = replace(LEG, joint_range=np.array([[0.5, 1.0], [-1.0, 1.0], [-1.0, 1.0]]))
    with pytest.raises(MotionError, match=r"joint hip is at 68\.\d+ deg") as raised:
        Motion.from_file(write(TIME, np.tile([1.2, 0, 0], (21, 1)), in_degrees=False), narrow)
    assert "inDegrees" not in str(raised.value)
