"""MuJoCo 4.0: a site less than 1e-6 m off its body's frame is put into that frame when the model is compiled."""

from __future__ import annotations

import pytest

mujoco = pytest.importorskip("mujoco", exc_type=ImportError)


def place(offset: float) -> float:
    """Where a site is that the model puts at so much along x."""
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body><freejoint/><inertial mass='1' pos='0 0 0' diaginertia='1 1 1'/>"
        f"<site name='pin' pos='{offset!r} 0 0'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return float(data.site_xpos[0, 0])


def test_larger_offsets_are_kept() -> None:
    assert place(1.1e-6) == 1.1e-6


@pytest.mark.xfail(
    strict=True, reason="offsets below 1e-6 are dropped; once kept, the adapter's line on sameframe can go"
)
def test_small_offsets_are_kept() -> None:
    assert place(9e-7) == 9e-7
