"""MuJoCo 4.0.0: inverse dynamics does not see hard loops, and one control beyond 1e10 takes all others with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known import control, defect

pytestmark = [
    pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True),
    pytest.mark.usefixtures("engine_name"),
]

LEVER = """
<mujoco>
  <compiler angle="radian" />
  <option gravity="0 -10 0" />
  <worldbody>
    <body>
      <inertial pos="1 0 0" mass="1" diaginertia="1 1 1" />
      <joint name="hinge" type="hinge" axis="0 0 1" />
      <site name="end" pos="1 0 0" />
    </body>
    <body pos="1 -1 0">
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1" />
      <joint name="slide" type="slide" axis="0 1 0" />
      <site name="top" pos="0 1 0" />
    </body>
  </worldbody>
  <equality><connect site1="end" site2="top" /></equality>
</mujoco>
"""
"""A lever on a free hinge, held up by a post that slides."""


@defect(
    "mj_inverse inverts MuJoCo's own soft loops: on a motion that keeps them closed they carry no force",
    "MujocoEngine.assemble, which takes mj_rne and efc_J, and solves for the loop forces itself",
)
def test_a_loop_at_rest_carries_the_weight() -> None:
    import mujoco

    m = mujoco.MjModel.from_xml_string(LEVER)
    d = mujoco.MjData(m)  # closed and at rest, with accelerations of zero
    mujoco.mj_inverse(m, d)
    hinge = m.joint("hinge").dofadr[0]
    control(abs(d.efc_pos).max() < 1e-15)
    control(abs(d.qfrc_bias[hinge] - 10.0) < 1e-12)  # N m of weight
    assert abs(d.qfrc_inverse[hinge]) < 1e-3  # the hinge is free: the post carries the lever


TWO_MASSES = """
<mujoco>
  <worldbody>
    <body><inertial pos="0 0 0" mass="1" diaginertia="1 1 1" /><joint name="x" type="slide" axis="1 0 0" /></body>
    <body><inertial pos="0 0 0" mass="1" diaginertia="1 1 1" /><joint name="y" type="slide" axis="0 1 0" /></body>
  </worldbody>
  <actuator><motor joint="x" /><motor joint="y" /></actuator>
</mujoco>
"""


@pytest.mark.parametrize("bad", [2e10, float("nan")])
@defect(
    "mj_forward sets all controls to zero where one is beyond 1e10 or not a number, and says so by a counter alone",
    "`forward` in mujoco_steps.py and MujocoEngine.require_quiet",
)
def test_a_bad_control_does_not_take_the_others_with_it(
    bad: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import mujoco

    monkeypatch.chdir(tmp_path)  # the log of warnings
    m = mujoco.MjModel.from_xml_string(TWO_MASSES)
    d = mujoco.MjData(m)
    d.ctrl[:] = 1.0, 9e9
    mujoco.mj_forward(m, d)
    control(np.array_equal(d.qfrc_actuator, [1.0, 9e9]))
    d.ctrl[:] = 1.0, bad
    try:
        mujoco.mj_forward(m, d)
    except Exception:
        return
    assert d.qfrc_actuator[0] == 1.0
