"""MuJoCo 4.0: a site less than 1e-6 m off its body's frame is put into that frame when the model is compiled."""

from __future__ import annotations

import pytest
from known import control, defect

MUJOCO = pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)


def place(offset: float) -> float:
    """Where a site is that the model puts at so much along x."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body><freejoint/><inertial mass='1' pos='0 0 0' diaginertia='1 1 1'/>"
        f"<site name='pin' pos='{offset!r} 0 0'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return float(data.site_xpos[0, 0])


@MUJOCO
@defect("Offsets below 1e-6 m are dropped", "MujocoEngine.__init__, which sets sameframe to zero")
def test_small_offsets_are_kept(engine_name: str) -> None:
    control(place(1.1e-6) == 1.1e-6)
    assert place(9e-7) == 9e-7
