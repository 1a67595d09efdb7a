"""Closed-form dynamics of a Stewart platform whose N legs are made of a base, a guide and a rod.

Voynov, Telegin, Timofeev 2016, DOI 10.14529/ctcr160403: the numbers (1)-(36) and the symbols are the paper's.

One text for every kind of number.  A vector is a tuple of three components; the text uses ``+ - * /`` and a square
root that is passed in, nothing else.  The same lines therefore run on Python floats, on NumPy arrays (samples along
the last axis), on long double, on ball arithmetic, and on traced numbers, whose list of operations is run by NumPy or
compiled (`backends`); trigonometry never appears, because s, c, s_o, c_o are ratios of lengths.

Where the paper's line cancels, a form without cancellation is used and the printed line stands beside it, under its
own number; the two are held equal by a test.

World frame O_r x_r y_r z_r, y_r along the base axes (up); the first axis of every array of the paper is a leg i,
which is left out below.

======================  =======================  =========  ====================================================
here                    paper                    unit       meaning
======================  =======================  =========  ====================================================
``m_o m_n m_s m_p``     m_o m_n m_s m_p          kg         mass of base, guide, rod, platform
``J_oz``                J_o^z                    kg m^2     base about its axis y_r
``J_nx J_ny``           J_n^x = J_n^z, J_n^y     kg m^2     guide about O_n: transverse, along y_n
``J_sx J_sz``           J_s^x = J_s^y, J_s^z     kg m^2     rod, central: transverse, along its axis y_n
``I_p``                 I_p                      kg m^2     platform, central, platform axes (3 x 3)
``a_n``                 a_n                      m          O_n to the guide's centre of mass, along y_n
``a``                   a = C_s O_r              m          rod's centre of mass to its tip, along y_n
``O``                   A, B, D                  m          hull pin O_o = O_n, world axes
``p``                   p_i                      m          platform pin O_r, platform axes
``g``                   g (vector)               m/s^2      gravity, world axes
``C_p dC_p ddC_p``      x_p, y_p, z_p            m, s       platform's centre of mass, velocity, acceleration
``R w_p dw_p``          omega_p                  rad, s     platform axes in the world, angular velocity, its rate
``q_o q_n q_s``         q_o, q_n, q_s            rad, m     base angle, guide angle, O_n to the rod's centre of mass
``dq_* ddq_*``          dots                     ... /s     their rates and accelerations
``L``                   L = q_s + a              m          leg length O_o O_r
``so co s c``           s_o, c_o, s, c           1          sin q_o, cos q_o, sin q_n, cos q_n
``x_n y_n z_n``         x_n, y_n, z_n            1          guide axes in the world, (9), (18)
``w``                   s q_o'                   rad/s      swing rate of the leg about x_n
``u``                   s q_o'' + 2 c q_n' q_o'  rad/s^2    swing acceleration about x_n (not singular at s = 0)
``nu``                  q_n'' - s c q_o'^2       rad/s^2    swing acceleration about z_n
``e``                   (c q_o')'                rad/s^2    spin acceleration about y_n
``r``                   C_p O_r                  m          lever of a platform pin, world axes
``J_q J_y m_q``         J_q, J_y, m_q            (5)        inertia of the leg about O_n, its first moment
``F_is M_in M_io_s``    F_is, M_in, M_io / s     N, N m     loads of a leg, (2)-(4)
``F``                   F                        N          driving force, along y_n on the rod from the guide
``X``                   F - F_is                 N          the unknown of (7), (8)
``F_r F_s F_n F_o``     F_r, F_s, F_n, F_o       N          on the rod's tip from the platform, on the rod from the
                                                            guide, on the guide from the base, on the base
``M_s M_n M_o``         M_s, M_n, M_o            N m        moments about the rod's centre of mass, O_n, O_o
======================  =======================  =========  ====================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

Scalar: TypeAlias = Any  # a float, a NumPy array of samples, a ball: whatever has + - * /
Vector: TypeAlias = tuple[Scalar, Scalar, Scalar]
Sqrt: TypeAlias = Callable[[Scalar], Scalar]
Solve: TypeAlias = Callable[[Sequence[Sequence[Scalar]], Sequence[Scalar]], Sequence[Scalar]]


# --- Parameters -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Leg:
    """Inertia and geometry shared by all legs (units in the symbol table). A leg without base has m_o = J_oz = 0."""

    m_n: Scalar
    a_n: Scalar
    J_nx: Scalar
    J_ny: Scalar
    m_s: Scalar
    a: Scalar
    J_sx: Scalar
    J_sz: Scalar
    m_o: Scalar = 0.0
    J_oz: Scalar = 0.0

    @property
    def spins(self) -> bool:
        """Whether J_oz + J_y > 0: only then does the base angle carry load, singular as 1/s."""
        return self.J_oz + self.J_ny + self.J_sz > 0


@dataclass(frozen=True)
class Load:
    """Outside force [N] at ``point`` [m, platform axes] and moment [N m] on the platform, world axes."""

    force: Vector = (0.0, 0.0, 0.0)
    moment: Vector = (0.0, 0.0, 0.0)
    point: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Parameters:
    """The whole machine: one leg type, the platform, N platform pins ``p``, N hull pins ``O``, gravity, the load."""

    leg: Leg
    m_p: Scalar
    I_p: tuple[Vector, Vector, Vector]
    p: tuple[Vector, ...]
    O: tuple[Vector, ...]
    g: Vector = (0.0, -9.81, 0.0)
    load: Load = Load()

    def __post_init__(self) -> None:
        if len(self.p) != len(self.O):
            raise ValueError(
                f"got {len(self.p)} platform pins p and {len(self.O)} hull pins O, expected one each per leg"
            )

    @property
    def equations(self) -> int:
        """Equations of the platform for the driving forces: (7), (8) have six."""
        return 6


class PlatformMotion(NamedTuple):
    """Pose, twist and acceleration of the platform's centre of mass, world axes. ``R``: rows of R_WP."""

    C_p: Any
    R: Any
    dC_p: Any
    w_p: Any
    ddC_p: Any
    dw_p: Any


class NotDeterminate(ValueError):
    """As many platform equations as driving forces are needed. ``determined`` holds what needs no F."""

    def __init__(self, N: int, equations: int, determined: Any) -> None:
        more = N - equations
        kind = f"underdetermined: {more} too many unknowns" if more > 0 else f"overdetermined: {-more} too many"
        source = "(7), (8)" if equations == 6 else "(32)" if equations == 3 else "(35)"
        super().__init__(
            f"N = {N} legs: {source} are {equations} equations for {N} driving forces, {kind}. "
            "F_is, M_in, M_io/s, the components of F_r along x_n and z_n, and M_s, M_n, M_o do not depend on F: "
            "they are in the attribute `determined` of this error"
        )
        self.determined = determined


# --- Vectors ----------------------------------------------------------------------------------------------------------


def add(a: Vector, b: Vector, *more: Vector) -> Vector:
    """Sum of vectors."""
    a = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
    for b in more:
        a = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
    return a


def sub(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def mul(k: Scalar, a: Vector) -> Vector:
    """Product k a."""
    return (k * a[0], k * a[1], k * a[2])


def dot(a: Vector, b: Vector) -> Scalar:
    """Scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def apply(A: Sequence[Vector], b: Vector) -> Vector:
    """Product A b, ``A`` by rows."""
    return (dot(A[0], b), dot(A[1], b), dot(A[2], b))


def apply_transposed(A: Sequence[Vector], b: Vector) -> Vector:
    """Product A^T b, ``A`` by rows."""
    return add(mul(b[0], A[0]), mul(b[1], A[1]), mul(b[2], A[2]))


# --- Inverse kinematics of a leg: (9), (18), (19), (31) and their time derivatives ------------------------------------

# A vertical leg (l_x = l_z = 0) has no base angle of its own; this length [m] makes it 0. Floats never see it, balls
# only beyond 490 bits.
VERTICAL = 1e-150


class LegState(NamedTuple):
    """What the loads need of a leg's motion. Nothing here is divided by s."""

    r: Vector
    L: Scalar
    q_s: Scalar
    so: Scalar
    co: Scalar
    s: Scalar
    c: Scalar
    x_n: Vector
    y_n: Vector
    z_n: Vector
    dq_s: Scalar
    dq_n: Scalar
    w: Scalar
    ddq_s: Scalar
    u: Scalar
    nu: Scalar
    A_y: Scalar  # acceleration of the tip along y_n


class HingeRates(NamedTuple):
    """Rates of the two passive hinges. dq_o, ddq_o and e are divided by s."""

    dq_o: Scalar
    ddq_o: Scalar
    ddq_n: Scalar
    e: Scalar


def leg_axes(so: Scalar, co: Scalar, s: Scalar, c: Scalar) -> tuple[Vector, Vector, Vector]:
    """x_n, y_n, z_n in the world, (9), (18)."""
    return (co * c, s, -so * c), (-co * s, c, so * s), (so, 0.0 * so, co)


def leg_kinematics(leg: Leg, p: Vector, O: Vector, motion: PlatformMotion, sqrt: Sqrt) -> LegState:
    """Inverse kinematics of one leg, from (19) and (31).

    Branch: s = sin q_n > 0, 0 < q_n < pi.  The other branch, (q_o + pi, -q_n), gives the same forces and moments.
    The difference C_p - O is formed before R p is added, which keeps the digits far from the world's origin.
    """
    C_p, R, dC_p, w_p, ddC_p, dw_p = motion
    r = apply(R, p)  # C_p O_r
    l = sub(add(sub(C_p, O), r), (VERTICAL, 0.0, 0.0))
    V = add(dC_p, cross(w_p, r))  # velocity of the tip
    A = add(ddC_p, cross(dw_p, r), cross(w_p, cross(w_p, r)))  # acceleration of the tip

    h = sqrt(l[0] * l[0] + l[2] * l[2])  # s L
    L = sqrt(dot(l, l))
    s, c = h / L, l[1] / L
    so, co = l[2] / h, -l[0] / h
    x_n, y_n, z_n = leg_axes(so, co, s, c)

    dq_s = dot(V, y_n)
    dq_n = -dot(V, x_n) / L
    w = dot(V, z_n) / L
    A_y = dot(A, y_n)
    return LegState(
        r=r, L=L, q_s=L - leg.a, so=so, co=co, s=s, c=c, x_n=x_n, y_n=y_n, z_n=z_n,
        dq_s=dq_s, dq_n=dq_n, w=w,
        ddq_s=A_y + L * (w * w + dq_n * dq_n),
        u=(dot(A, z_n) - 2.0 * dq_s * w) / L,
        nu=-(dot(A, x_n) + 2.0 * dq_s * dq_n) / L,
        A_y=A_y,
    )  # fmt: skip


def hinge_rates(k: LegState) -> HingeRates:
    """q_o', q_o'', q_n'' and e = (c q_o')' of a leg with s > 0."""
    dq_o = k.w / k.s
    ddq_o = (k.u - 2.0 * k.c * k.dq_n * dq_o) / k.s
    return HingeRates(
        dq_o=dq_o, ddq_o=ddq_o, ddq_n=k.nu + k.c * k.w * dq_o, e=k.c * ddq_o - k.dq_n * k.w
    )  # fmt: skip


def lever_printed(k: LegState, O: Vector, C_p: Vector) -> Vector:
    """C_p O_r [m] by (19), the loop closure (31): equal to the lever r = R p_i."""
    return add(mul(k.L, k.y_n), sub(O, C_p))


def loop_printed(k: LegState, O: Vector, C_p: Vector) -> Vector:
    """Right sides of (31) [m] as printed, x_r, y_r, z_r of C_p O_r = p_i (p^x, p^y, p^z)."""
    return (-k.co * k.s * k.L + O[0] - C_p[0], k.c * k.L + O[1] - C_p[1], k.so * k.s * k.L + O[2] - C_p[2])


def in_world(k: LegState, x: Scalar, y: Scalar, z: Scalar) -> Vector:
    """The vector x x_n + y y_n + z z_n, by (18)."""
    return add(mul(x, k.x_n), mul(z, k.z_n), mul(y, k.y_n))


# --- Statement 1: reaction in the spherical joint, (1)-(6) ------------------------------------------------------------


class Loads(NamedTuple):
    """F_is [N], M_in [N m] and M_io / s [N m] of a leg, (2)-(4)."""

    F_is: Scalar
    M_in: Scalar
    M_io_s: Scalar


def inertia(leg: Leg, q_s: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """J_q [kg m^2], J_y [kg m^2], m_q [kg m]: (5)."""
    J_q = leg.J_nx + leg.J_sx + leg.m_s * q_s * q_s
    J_y = leg.J_ny + leg.J_sz
    m_q = leg.m_n * leg.a_n + leg.m_s * q_s
    return J_q, J_y, m_q


def leg_loads(leg: Leg, k: LegState, g: Vector) -> Loads:
    """(2)-(4) from the tip's motion, any gravity.

    The moments of gravity and J_q never meet their own opposites here, and 1/s stands only beside J_oz and J_y:
    a leg that does not spin may be vertical.
    """
    J_q, J_y, m_q = inertia(leg, k.q_s)
    coriolis = 2.0 * leg.m_s * k.q_s * k.dq_s
    F_is = leg.m_s * (k.A_y + leg.a * (k.w * k.w + k.dq_n * k.dq_n) - dot(k.y_n, g))  # (2)
    M_in = J_q * k.nu + coriolis * k.dq_n + m_q * dot(k.x_n, g)  # (3)
    M_io_s = J_q * k.u + coriolis * k.w - m_q * dot(k.z_n, g)  # (4) / s
    if leg.spins:
        h = hinge_rates(k)
        M_in = M_in + J_y * k.c * k.w * h.dq_o
        M_io_s = M_io_s - J_y * k.c * k.dq_n * h.dq_o + (leg.J_oz * h.ddq_o + k.c * J_y * h.e) / k.s
    return Loads(F_is, M_in, M_io_s)


def second_derivative_along(k: LegState, h: HingeRates, f: Scalar, df: Scalar, ddf: Scalar) -> Vector:
    """d^2(f y_n)/dt^2, world axes, from the joint coordinates: used by (2), (6), (24), (25)."""
    return in_world(
        k,
        -f * (h.ddq_n - k.s * k.c * h.dq_o * h.dq_o) - 2.0 * df * k.dq_n,
        ddf - f * (k.s * k.s * h.dq_o * h.dq_o + k.dq_n * k.dq_n),
        f * (k.s * h.ddq_o + 2.0 * k.c * k.dq_n * h.dq_o) + 2.0 * df * k.s * h.dq_o,
    )


def moment_rate(k: LegState, h: HingeRates, J_x: Scalar, dJ_x: Scalar, J_y: Scalar) -> Vector:
    """(J_x s q_o' x_n + J_y c q_o' y_n + J_x q_n' z_n)'_t [N m], world axes: used by (3), (4), (27), (28)."""
    K = (J_x * k.s * h.dq_o, J_y * k.c * h.dq_o, J_x * k.dq_n)
    dK = (
        dJ_x * k.s * h.dq_o + J_x * (k.c * k.dq_n * h.dq_o + k.s * h.ddq_o),
        J_y * (k.c * h.ddq_o - k.s * k.dq_n * h.dq_o),
        dJ_x * k.dq_n + J_x * h.ddq_n,
    )
    omega_n = (k.s * h.dq_o, k.c * h.dq_o, k.dq_n)  # the guide's angular velocity in its own axes
    return in_world(k, *add(dK, cross(omega_n, K)))


def momentum_rate_of_leg(leg: Leg, k: LegState, h: HingeRates) -> Vector:
    """(J_q s q_o' x_n + J_y c q_o' y_n + J_q q_n' z_n)'_t, of guide and rod about O_n: in (3), (4), (28)."""
    J_q, J_y, _ = inertia(leg, k.q_s)
    return moment_rate(k, h, J_q, 2.0 * leg.m_s * k.q_s * k.dq_s, J_y)


def leg_loads_printed(leg: Leg, k: LegState, h: HingeRates, g: Vector) -> Loads:
    """(2)-(4) as printed, any gravity."""
    _, _, m_q = inertia(leg, k.q_s)
    dK = momentum_rate_of_leg(leg, k, h)
    F_is = leg.m_s * dot(k.y_n, sub(second_derivative_along(k, h, k.q_s, k.dq_s, k.ddq_s), g))  # (2)
    M_in = dot(k.z_n, dK) + m_q * dot(k.x_n, g)  # (3)
    M_io = leg.J_oz * h.ddq_o + dK[1] - m_q * k.s * dot(k.z_n, g)  # (4), z_o = y_r
    return Loads(F_is, M_in, M_io / k.s)


def joint_reaction_r(k: LegState, loads: Loads, X: Scalar) -> Vector:
    """F_r, (1) = (23): force on the rod's tip from the platform, world axes [N]; X = F - F_is."""
    return in_world(k, -loads.M_in / k.L, -X, loads.M_io_s / k.L)


def rod_load_printed(leg: Leg, k: LegState, h: HingeRates, g: Vector) -> Vector:
    """The vector F_is [N] of (6), inertia and weight of the rod, world axes; its part along y_n is F_is of (2)."""
    return mul(leg.m_s, sub(second_derivative_along(k, h, k.q_s, k.dq_s, k.ddq_s), g))


def rod_balance_printed(leg: Leg, k: LegState, h: HingeRates, F_s: Vector, g: Vector) -> Vector:
    """F_r [N], world axes, from the rod's own balance: (6) as printed, any gravity."""
    return sub(rod_load_printed(leg, k, h, g), F_s)


# --- Statement 2: driving forces, (7)-(15) ----------------------------------------------------------------------------


def platform_momentum_rate(P: Parameters, motion: PlatformMotion) -> Vector:
    """(I_p . w_p)'_t [N m], world axes, of (8)."""
    w_P = apply_transposed(motion.R, motion.w_p)
    dw_P = apply_transposed(motion.R, motion.dw_p)
    return apply(motion.R, add(apply(P.I_p, dw_P), cross(w_P, apply(P.I_p, w_P))))


def platform_momentum_rate_principal(
    moments: Vector, axes: Sequence[Vector], daxes: Sequence[Vector], pqr: Vector, dpqr: Vector
) -> Vector:
    """(I_p . w_p)'_t [N m], world axes, as the text under (8) has it, with principal moments A_p, B_p, C_p.

    ``axes``: principal axes x_p, y_p, z_p in the world, ``daxes`` their rates; ``pqr``: w_p along them, ``dpqr`` rates.
    """
    return add(
        *(add(mul(J * dp, e), mul(J * p, de)) for J, e, de, p, dp in zip(moments, axes, daxes, pqr, dpqr, strict=True))
    )


def platform_balance_printed(
    P: Parameters, motion: PlatformMotion, levers: Sequence[Vector], F_r: Sequence[Vector]
) -> tuple[Vector, Vector]:
    """(15) as printed, left less right sides [N], [N m]: zero for the forces F_r on the rods and levers C_p O_r."""
    return (
        add(mul(P.m_p, sub(motion.ddC_p, P.g)), *F_r),
        add(platform_momentum_rate(P, motion), *(cross(r, f) for r, f in zip(levers, F_r, strict=True))),
    )


def outside_wrench(P: Parameters | PlanarParameters, motion: PlatformMotion) -> tuple[Vector, Vector]:
    """Force [N] and moment about C_p [N m] of the load, world axes; not in the paper, added to (15)."""
    return P.load.force, add(P.load.moment, cross(apply(motion.R, P.load.point), P.load.force))


def platform_equations(
    P: Parameters, motion: PlatformMotion, legs: Sequence[LegState], loads: Sequence[Loads]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """(7), (8): six rows in the N unknowns X = F - F_is, and their right sides.

    Rows: x_r, y_r, z_r of (7) [N], then of (8) about C_p [N m].  The levers are r = R p, not O - C_p + L y_n as in
    (10)-(14): no difference of large terms for a small platform.
    """
    force, moment = outside_wrench(P, motion)
    right_7 = sub(mul(P.m_p, sub(motion.ddC_p, P.g)), force)
    right_8 = sub(platform_momentum_rate(P, motion), moment)
    columns = []
    for k, load in zip(legs, loads, strict=True):
        f = in_world(k, load.M_in / k.L, 0.0, -load.M_io_s / k.L)  # -F_r without its part along y_n
        right_7 = sub(right_7, f)
        right_8 = sub(right_8, cross(k.r, f))
        columns.append((*k.y_n, *cross(k.r, k.y_n)))
    rows = [[column[j] for column in columns] for j in range(6)]
    return rows, [*right_7, *right_8]


def cosines_printed(k: LegState) -> tuple[Vector, Vector]:
    """(x^x, x^y, x^z) and (y^x, y^y, y^z), direction cosines of x_n and y_n: (9) as printed."""
    return (k.co * k.c, k.s, -k.so * k.c), (-k.co * k.s, k.c, k.so * k.s)


def hull_pin_printed(O: Vector, C_p: Vector) -> Vector:
    """x, y, z [m], the hull pin seen from C_p: (10) as printed."""
    return sub(O, C_p)


def arms_printed(k: LegState, O: Vector, C_p: Vector) -> Vector:
    """y_x, y_y, y_z [m], moment of a unit force along y_n about C_p: (11) as printed."""
    x, y, z = hull_pin_printed(O, C_p)
    _, (yx, _, yz) = cosines_printed(k)
    return (y * yz - z * k.c, z * yx - x * yz, x * k.c - y * yx)


def moments_printed(k: LegState, O: Vector, C_p: Vector, loads: Loads) -> Vector:
    """Share of one leg in M_x, M_y, M_z [N m]: (12)-(14) as printed."""
    L, so, co, s, M_in, M_io_s = k.L, k.so, k.co, k.s, loads.M_in, loads.M_io_s
    (xx, _, xz), _ = cosines_printed(k)
    x, y, z = hull_pin_printed(O, C_p)
    return (
        (M_in * (y * xz - z * s - L * so) - M_io_s * (y * co + L * xx)) / L,  # (12)
        (M_in * (z * xx - x * xz) - M_io_s * (z * so - x * co + L * s)) / L,  # (13)
        (M_in * (x * s - y * xx - L * co) - M_io_s * (L * xz - y * so)) / L,  # (14)
    )


def platform_equations_printed(
    P: Parameters, motion: PlatformMotion, legs: Sequence[LegState], loads: Sequence[Loads]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """The scalar 6 x 6 system: x_r, y_r, z_r of (7) and (8) with the coefficients (9)-(14) as printed."""
    rows: list[list[Scalar]] = [[] for _ in range(6)]
    right = [*mul(P.m_p, sub(motion.ddC_p, P.g)), *platform_momentum_rate(P, motion)]
    for k, O, load in zip(legs, P.O, loads, strict=True):
        _, y_n = cosines_printed(k)
        f = mul(1.0 / k.L, sub(mul(load.M_in, k.x_n), mul(load.M_io_s, k.z_n)))
        for row, value in zip(rows, (*y_n, *arms_printed(k, O, motion.C_p)), strict=True):
            row.append(value)
        M = moments_printed(k, O, motion.C_p, load)
        right = [b - d for b, d in zip(right, (*f, *M), strict=True)]
    force, moment = outside_wrench(P, motion)
    return rows, [b - d for b, d in zip(right, (*force, *moment), strict=True)]


# --- Scalar loads under vertical gravity, (20)-(22) -------------------------------------------------------------------


def leg_loads_scalar(leg: Leg, k: LegState, h: HingeRates, g: Vector) -> Loads:
    """(20)-(22) as printed. Raises ValueError unless gravity is along -y_r."""
    if g[0] != 0 or g[2] != 0:
        raise ValueError(f"(20)-(22) hold for gravity along -y_r only, got g = {g}: use (2)-(4)")
    g_ = -g[1]
    J_q, J_y, m_q = inertia(leg, k.q_s)
    J = J_q - J_y
    G = -g_ * m_q * k.s
    m_s, q_s, dq_s, s, c, dq_n, dq_o = leg.m_s, k.q_s, k.dq_s, k.s, k.c, k.dq_n, h.dq_o
    F_is = m_s * (k.ddq_s - q_s * s * s * dq_o * dq_o - q_s * dq_n * dq_n + g_ * c)  # (20)
    M_in = J_q * h.ddq_n - J * s * c * dq_o * dq_o + 2.0 * m_s * q_s * dq_n * dq_s + G  # (21)
    M_io = (leg.J_oz + J_q - J * c * c) * h.ddq_o + 2.0 * s * (m_s * q_s * s * dq_s + J * c * dq_n) * dq_o  # (22)
    return Loads(F_is, M_in, M_io / s)


def projections_of_F_r(k: LegState, loads: Loads, F: Scalar) -> Vector:
    """x_n . F_r, y_n . F_r, z_n . F_r [N]: the scalar form of (23)."""
    return (-loads.M_in / k.L, loads.F_is - F, loads.M_io_s / k.L)


# --- Statement 3: reactions in the joints of a leg, (23)-(30) ---------------------------------------------------------


class Moments(NamedTuple):
    """M_s about the rod's centre of mass, M_n about O_n, M_o about O_o, world axes [N m]. Independent of F."""

    M_s: Vector
    M_n: Vector
    M_o: Vector


class Forces(NamedTuple):
    """F_r, F_s, F_n, F_o, world axes [N]."""

    F_r: Vector
    F_s: Vector
    F_n: Vector
    F_o: Vector


def joint_forces(leg: Leg, k: LegState, loads: Loads, X: Scalar, g: Vector) -> Forces:
    """(23)-(26), any gravity, with the second derivatives taken from the tip's motion."""
    swing = k.w * k.w + k.dq_n * k.dq_n
    ddq_s_y_n = in_world(
        k,
        -(k.q_s * k.nu + 2.0 * k.dq_s * k.dq_n),
        k.A_y + leg.a * swing,
        k.q_s * k.u + 2.0 * k.dq_s * k.w,
    )
    ddy_n = in_world(k, -k.nu, -swing, k.u)
    F_r = joint_reaction_r(k, loads, X)  # (23)
    F_s = sub(mul(leg.m_s, sub(ddq_s_y_n, g)), F_r)  # (24)
    F_n = add(F_s, mul(leg.m_n, sub(mul(leg.a_n, ddy_n), g)))  # (25)
    F_o = sub(F_n, mul(leg.m_o, g))  # (26)
    return Forces(F_r, F_s, F_n, F_o)


def joint_moments(leg: Leg, k: LegState, loads: Loads) -> Moments:
    """(27)-(29) reduced: gravity and J_q cancel out of M_n and M_o, which only J_oz and J_y load.

    M_o is along x_o = (co, 0, -so); without J_oz and J_y both M_n and M_o vanish.
    """
    M_s_x = leg.J_sx * k.u - leg.a * loads.M_io_s / k.L
    M_s_z = leg.J_sx * k.nu - leg.a * loads.M_in / k.L
    zero = 0.0 * k.L
    if not leg.spins:
        return Moments(in_world(k, M_s_x, zero, M_s_z), (zero, zero, zero), (zero, zero, zero))
    h = hinge_rates(k)
    x_o = (k.co, zero, -k.so)
    J_y = leg.J_ny + leg.J_sz
    M_s = in_world(
        k, M_s_x - leg.J_sz * k.c * k.dq_n * h.dq_o, leg.J_sz * h.e, M_s_z + leg.J_sz * k.c * k.w * h.dq_o
    )  # (27)
    M_n = sub(mul(-J_y * h.e / k.s, x_o), mul(leg.J_oz * h.ddq_o / k.s, k.x_n))  # (28)
    M_o = mul(-(J_y * h.e + k.c * leg.J_oz * h.ddq_o) / k.s, x_o)  # (29)
    return Moments(M_s, M_n, M_o)


def joint_forces_printed(leg: Leg, k: LegState, h: HingeRates, loads: Loads, F: Scalar, g: Vector) -> Forces:
    """(23)-(26) as printed, with -g_vec in place of g y_r."""
    _, _, m_q = inertia(leg, k.q_s)
    F_r = in_world(k, *projections_of_F_r(k, loads, F))  # (23)
    dd_s = second_derivative_along(k, h, k.q_s, k.dq_s, k.ddq_s)
    dd_q = second_derivative_along(k, h, m_q, leg.m_s * k.dq_s, leg.m_s * k.ddq_s)
    F_s = sub(mul(leg.m_s, sub(dd_s, g)), F_r)  # (24)
    F_n = sub(sub(dd_q, mul(leg.m_n + leg.m_s, g)), F_r)  # (25)
    F_o = sub(F_n, mul(leg.m_o, g))  # (26)
    return Forces(F_r, F_s, F_n, F_o)


def y_x_F_r_printed(k: LegState, loads: Loads) -> Vector:
    """y_n x F_r [N], world axes: (30) as printed."""
    return in_world(k, loads.M_io_s / k.L, 0.0 * k.L, loads.M_in / k.L)


def joint_moments_printed(leg: Leg, k: LegState, h: HingeRates, loads: Loads, g: Vector) -> Moments:
    """(27)-(29) as printed; G z_n of (28) is -m_q y_n x g, which serves any gravity."""
    _, _, m_q = inertia(leg, k.q_s)
    zero = 0.0 * k.L
    y_x_F_r = y_x_F_r_printed(k, loads)  # (30)
    M_s = sub(moment_rate(k, h, leg.J_sx, zero, leg.J_sz), mul(leg.a, y_x_F_r))  # (27)
    M_n = sub(sub(momentum_rate_of_leg(leg, k, h), mul(k.L, y_x_F_r)), mul(m_q, cross(k.y_n, g)))  # (28)
    M_o = add((zero, leg.J_oz * h.ddq_o, zero), M_n)  # (29)
    return Moments(M_s, M_n, M_o)


# --- The first problem of dynamics ------------------------------------------------------------------------------------


class Determined(NamedTuple):
    """What the motion alone determines, whatever N: one entry per leg."""

    legs: list[LegState]
    loads: list[Loads]
    moments: list[Moments]


class Driven(NamedTuple):
    """Driving forces and what they come from, one entry per leg; X = F - F_is."""

    legs: list[LegState]
    loads: list[Loads]
    X: Sequence[Scalar]
    F: list[Scalar]


class FirstProblem(NamedTuple):
    """Driving forces and all joint reactions, one entry per leg."""

    legs: list[LegState]
    F: list[Scalar]
    forces: list[Forces]
    moments: list[Moments]


def determined(P: Parameters, motion: PlatformMotion, sqrt: Sqrt) -> Determined:
    """Leg kinematics, (2)-(4) and (27)-(29): everything that does not need the driving forces, for any N."""
    legs = [leg_kinematics(P.leg, p, O, motion, sqrt) for p, O in zip(P.p, P.O, strict=True)]
    loads = [leg_loads(P.leg, k, P.g) for k in legs]
    return Determined(legs, loads, [joint_moments(P.leg, k, load) for k, load in zip(legs, loads, strict=True)])


def driven(P: Parameters, motion: PlatformMotion, sqrt: Sqrt, solve: Solve) -> Driven:
    """Driving forces by (7), (8). Parameters and errors as `first_problem`."""
    if len(P.p) != P.equations:
        raise NotDeterminate(len(P.p), P.equations, determined(P, motion, sqrt))
    legs = [leg_kinematics(P.leg, p, O, motion, sqrt) for p, O in zip(P.p, P.O, strict=True)]
    loads = [leg_loads(P.leg, k, P.g) for k in legs]
    X = solve(*platform_equations(P, motion, legs, loads))
    return Driven(legs, loads, X, [X_i + load.F_is for X_i, load in zip(X, loads, strict=True)])


def first_problem(P: Parameters, motion: PlatformMotion, sqrt: Sqrt, solve: Solve) -> FirstProblem:
    """Inverse dynamics: the motion is given, F by (7), (8) and every joint reaction by (23)-(29) are wanted.

    Parameters
    ----------
    P, motion
        Numbers of any one kind; see the symbol table for units and frames.
    sqrt, solve
        Square root of that kind; ``solve(rows, right)`` for six rows of six numbers.

    Raises
    ------
    NotDeterminate
        N is not 6.
    """
    legs, loads, X, F = driven(P, motion, sqrt, solve)
    forces = [joint_forces(P.leg, k, load, X_i, P.g) for k, load, X_i in zip(legs, loads, X, strict=True)]
    return FirstProblem(legs, F, forces, [joint_moments(P.leg, k, load) for k, load in zip(legs, loads, strict=True)])


def first_problem_printed(P: Parameters, motion: PlatformMotion, sqrt: Sqrt, solve: Solve) -> FirstProblem:
    """Inverse dynamics by the scalar equations as printed: (7)-(14), (20)-(22), (23)-(29). Parameters as above.

    Raises
    ------
    ValueError
        Gravity is not along -y_r.
    """
    legs = [leg_kinematics(P.leg, p, O, motion, sqrt) for p, O in zip(P.p, P.O, strict=True)]
    rates = [hinge_rates(k) for k in legs]
    loads = [leg_loads_scalar(P.leg, k, h, P.g) for k, h in zip(legs, rates, strict=True)]
    X = solve(*platform_equations_printed(P, motion, legs, loads))
    F = [X_i + load.F_is for X_i, load in zip(X, loads, strict=True)]
    each = list(zip(legs, rates, loads, strict=True))
    forces = [joint_forces_printed(P.leg, k, h, load, f, P.g) for (k, h, load), f in zip(each, F, strict=True)]
    return FirstProblem(legs, F, forces, [joint_moments_printed(P.leg, k, h, load, P.g) for k, h, load in each])


# --- Planar mechanisms without bases: examples 1 to 3, (32)-(36) ------------------------------------------------------
#
# Everything moves in x_r y_r, q_o = 0.  A vector has the components (x, y), a moment is along z_r.  Without bases
# M_io = 0: its terms, which would be 0/0 for a vertical leg, do not exist here.  A leg points anywhere, s has a sign.

Plane: TypeAlias = tuple[Scalar, Scalar]


@dataclass(frozen=True)
class PlanarParameters:
    """A planar mechanism: legs of guide and rod; pins and gravity as in `Parameters`, their z components are not read.

    ``J_pz``: central moment of inertia of the platform about z [kg m^2]; None: the platform is a point mass.
    """

    leg: Leg
    m_p: Scalar
    J_pz: Scalar | None
    p: tuple[Vector, ...]
    O: tuple[Vector, ...]
    g: Vector = (0.0, -9.81, 0.0)
    load: Load = Load()

    @property
    def equations(self) -> int:
        """Equations of the platform for the driving forces: (32) has three, (35) two."""
        return 2 if self.J_pz is None else 3


class PlanarLegState(NamedTuple):
    """Motion of a planar leg: x_n = (c, s), y_n = (-s, c)."""

    r: Plane
    L: Scalar
    q_s: Scalar
    s: Scalar
    c: Scalar
    dq_s: Scalar
    dq_n: Scalar
    ddq_s: Scalar
    ddq_n: Scalar
    A_y: Scalar  # acceleration of the tip along y_n


class PlanarLoads(NamedTuple):
    """F_is [N] and M_in [N m] of a planar leg, (33)."""

    F_is: Scalar
    M_in: Scalar


class PlanarReactions(NamedTuple):
    """F_r, F_s, F_n [N], components (x, y), and M_s [N m] about the rod's centre of mass. M_n = 0."""

    F_r: Plane
    F_s: Plane
    F_n: Plane
    M_s: Scalar


class PlanarDriven(NamedTuple):
    """Driving forces of a planar mechanism and what they come from, one entry per leg."""

    legs: list[PlanarLegState]
    loads: list[PlanarLoads]
    F: list[Scalar]


class PlanarProblem(NamedTuple):
    """Driving forces and joint reactions of a planar mechanism, one entry per leg."""

    legs: list[PlanarLegState]
    F: list[Scalar]
    reactions: list[PlanarReactions]


def planar_leg_kinematics(leg: Leg, p: Vector, O: Vector, motion: PlatformMotion, sqrt: Sqrt) -> PlanarLegState:
    """Inverse kinematics of one planar leg, from (34), (36). A point mass has p = 0."""
    C_p, R, dC_p, w_p, ddC_p, dw_p = motion
    cos, sin, w, dw = R[0][0], R[1][0], w_p[2], dw_p[2]
    r = (cos * p[0] - sin * p[1], sin * p[0] + cos * p[1])
    l = ((C_p[0] - O[0]) + r[0], (C_p[1] - O[1]) + r[1])
    V = (dC_p[0] - w * r[1], dC_p[1] + w * r[0])  # velocity of the tip
    A = (ddC_p[0] - dw * r[1] - w * w * r[0], ddC_p[1] + dw * r[0] - w * w * r[1])

    L = sqrt(l[0] * l[0] + l[1] * l[1])
    s, c = -l[0] / L, l[1] / L
    dq_s = c * V[1] - s * V[0]
    dq_n = -(c * V[0] + s * V[1]) / L
    A_y = c * A[1] - s * A[0]
    return PlanarLegState(
        r=r, L=L, q_s=L - leg.a, s=s, c=c,
        dq_s=dq_s, dq_n=dq_n,
        ddq_s=A_y + L * dq_n * dq_n,
        ddq_n=-(c * A[0] + s * A[1] + 2.0 * dq_s * dq_n) / L,
        A_y=A_y,
    )  # fmt: skip


def planar_loads(leg: Leg, k: PlanarLegState, g: Vector) -> PlanarLoads:
    """(33) from the tip's motion, any gravity in the plane."""
    J_q, _, m_q = inertia(leg, k.q_s)
    F_is = leg.m_s * (k.A_y + leg.a * k.dq_n * k.dq_n - (k.c * g[1] - k.s * g[0]))
    M_in = J_q * k.ddq_n + 2.0 * leg.m_s * k.q_s * k.dq_n * k.dq_s + m_q * (k.c * g[0] + k.s * g[1])
    return PlanarLoads(F_is, M_in)


def planar_loads_printed(leg: Leg, k: PlanarLegState, g: Vector) -> PlanarLoads:
    """(33) as printed. Raises ValueError unless gravity is along -y_r."""
    if g[0] != 0:
        raise ValueError(f"(33) holds for gravity along -y_r only, got g = {g}: use `planar_loads`")
    J_q, _, m_q = inertia(leg, k.q_s)
    g_ = -g[1]
    G = -g_ * m_q * k.s
    F_is = leg.m_s * (k.ddq_s - k.q_s * k.dq_n * k.dq_n + g_ * k.c)
    M_in = J_q * k.ddq_n + 2.0 * leg.m_s * k.q_s * k.dq_n * k.dq_s + G
    return PlanarLoads(F_is, M_in)


def planar_platform_equations(
    P: PlanarParameters, motion: PlatformMotion, legs: Sequence[PlanarLegState], loads: Sequence[PlanarLoads]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """(32), or (35) for a point mass, any gravity in the plane and a load: rows in the driving forces, right sides.

    Rows: y_r comes second, moments about C_p [N m] third, with the levers r = R p; signs as in (7), (8).
    """
    ddC_p, f = motion.ddC_p, P.load.force
    right = [P.m_p * (ddC_p[0] - P.g[0]) - f[0], P.m_p * (ddC_p[1] - P.g[1]) - f[1]]
    if P.J_pz is not None:
        cos, sin, q = motion.R[0][0], motion.R[1][0], P.load.point
        lever = (cos * q[0] - sin * q[1], sin * q[0] + cos * q[1])
        right.append(P.J_pz * motion.dw_p[2] - P.load.moment[2] - (lever[0] * f[1] - lever[1] * f[0]))
    columns = []
    for k, (F_is, M_in) in zip(legs, loads, strict=True):
        y_n = (-k.s, k.c)
        push = (F_is * y_n[0] - M_in * k.c / k.L, F_is * y_n[1] - M_in * k.s / k.L)  # -F_r without its share of F
        column, terms = [*y_n], [*push]
        if P.J_pz is not None:
            column.append(k.r[0] * y_n[1] - k.r[1] * y_n[0])
            terms.append(k.r[0] * push[1] - k.r[1] * push[0])
        columns.append(column)
        right = [b + term for b, term in zip(right, terms, strict=True)]
    return [[column[j] for column in columns] for j in range(P.equations)], right


def planar_platform_equations_printed(
    P: PlanarParameters, motion: PlatformMotion, legs: Sequence[PlanarLegState], loads: Sequence[PlanarLoads]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """(32), or its first two rows (35) for a point mass, as printed: gravity along -y_r, no load, hull pins on x_r."""
    x_p, y_p = motion.C_p[0], motion.C_p[1]
    rows: list[list[Scalar]] = [[], [], []]
    right = [-P.m_p * motion.ddC_p[0], P.m_p * (motion.ddC_p[1] - P.g[1]), (P.J_pz or 0.0) * motion.dw_p[2]]
    for k, O, (F_is, M_in) in zip(legs, P.O, loads, strict=True):
        L, s, c, X = k.L, k.s, k.c, O[0] - x_p
        y_z = X * c - y_p * s
        M_z = M_in * (X * s + y_p * c - L) / L
        for row, value in zip(rows, (s, c, y_z), strict=True):
            row.append(value)
        terms = (s * F_is + M_in * c / L, c * F_is - M_in * s / L, y_z * F_is - M_z)
        right = [b + term for b, term in zip(right, terms, strict=True)]
    return rows[: P.equations], right[: P.equations]


def loops_of_example_1(legs: Sequence[PlanarLegState], motion: PlatformMotion, b: Scalar, A: Scalar) -> list[Scalar]:
    """(34) as printed: six residuals [m] of the bar with pins at distance b, hull pins at 0, A, A on x_r."""
    (x_p, y_p, _), cos, sin = motion.C_p, motion.R[0][0], motion.R[1][0]
    k_1, k_2, k_3 = legs
    return [
        b * cos - (k_1.s * k_1.L + x_p),
        b * cos - (k_2.s * k_2.L - A + x_p),
        b * cos - (-k_3.s * k_3.L + A - x_p),
        b * sin - (y_p - k_1.c * k_1.L),
        b * sin - (y_p - k_2.c * k_2.L),
        b * sin - (k_3.c * k_3.L - y_p),
    ]


def loops_of_example_2(legs: Sequence[PlanarLegState], motion: PlatformMotion, A: Scalar) -> list[Scalar]:
    """(36) as printed: four residuals [m] of the point mass, hull pins at 0 and A on x_r."""
    x_p, y_p, _ = motion.C_p
    k_1, k_2 = legs
    return [k_1.s * k_1.L + x_p, k_2.s * k_2.L - A + x_p, y_p - k_1.c * k_1.L, y_p - k_2.c * k_2.L]


def difference_of_example_3(P: PlanarParameters, ddx_p: Scalar) -> Scalar:
    """F_1 - F_2 [N] of two legs along x_r, q_n1 = -90 deg, q_n2 = 90 deg; F_1 + F_2 is not determined."""
    return (P.m_p + 2.0 * P.leg.m_s) * ddx_p


def sag_of_example_3(P: PlanarParameters, legs: Sequence[PlanarLegState]) -> Scalar:
    """y_p'' [m/s^2] that gravity forces on two legs along x_r momentarily at rest: any other one has no forces."""
    first, second = P.m_p, P.m_p
    for k in legs:
        J_q, _, m_q = inertia(P.leg, k.q_s)
        first, second = first + m_q / k.L, second + J_q / (k.L * k.L)
    return P.g[1] * first / second


def planar_reactions(leg: Leg, k: PlanarLegState, loads: PlanarLoads, F: Scalar, g: Vector) -> PlanarReactions:
    """(23)-(25), (27) with q_o = 0, any gravity in the plane."""

    def in_plane(x: Scalar, y: Scalar) -> Plane:
        return (x * k.c - y * k.s, x * k.s + y * k.c)

    def plus(a: Plane, m: Scalar, b: Plane) -> Plane:
        return (a[0] + m * (b[0] - g[0]), a[1] + m * (b[1] - g[1]))

    swing = k.dq_n * k.dq_n
    rod = in_plane(-(k.q_s * k.ddq_n + 2.0 * k.dq_s * k.dq_n), k.A_y + leg.a * swing)
    guide = in_plane(-leg.a_n * k.ddq_n, -leg.a_n * swing)
    F_r = in_plane(-loads.M_in / k.L, loads.F_is - F)  # (23)
    F_s = plus((-F_r[0], -F_r[1]), leg.m_s, rod)  # (24)
    F_n = plus(F_s, leg.m_n, guide)  # (25)
    return PlanarReactions(F_r, F_s, F_n, leg.J_sx * k.ddq_n - leg.a * loads.M_in / k.L)  # (27)


def planar_driven(P: PlanarParameters, motion: PlatformMotion, sqrt: Sqrt, solve: Solve) -> PlanarDriven:
    """Driving forces by (32) or (35). Parameters and errors as `planar_problem`."""
    legs = [planar_leg_kinematics(P.leg, p, O, motion, sqrt) for p, O in zip(P.p, P.O, strict=True)]
    loads = [planar_loads(P.leg, k, P.g) for k in legs]
    if len(legs) != P.equations:
        raise NotDeterminate(len(legs), P.equations, (legs, loads))
    return PlanarDriven(legs, loads, list(solve(*planar_platform_equations(P, motion, legs, loads))))


def planar_problem(P: PlanarParameters, motion: PlatformMotion, sqrt: Sqrt, solve: Solve) -> PlanarProblem:
    """Inverse dynamics of a planar mechanism: F by (32) or (35), joint reactions by (23)-(25), (27).

    Parameters as in `first_problem`, ``solve`` for `PlanarParameters.equations` rows.

    Raises
    ------
    NotDeterminate
        N is not 3, or not 2 for a point mass.
    """
    legs, loads, F = planar_driven(P, motion, sqrt, solve)
    reactions = [planar_reactions(P.leg, k, load, F_i, P.g) for k, load, F_i in zip(legs, loads, F, strict=True)]
    return PlanarProblem(legs, F, reactions)


def planar_screw(k: PlanarLegState, n: Plane) -> tuple[Scalar, Scalar, Scalar]:
    """(n, r x n): a unit force along n at the pin, about C_p; and n . (dC_p + w_p x r) as a row in (dC_p, w_p)."""
    return (*n, k.r[0] * n[1] - k.r[1] * n[0])


def planar_bordered(
    P: PlanarParameters, motion: PlatformMotion, legs: Sequence[PlanarLegState], F: Sequence[Scalar]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Inertia of the platform (3 x 3, or 2 x 2) and the forces on it at zero accelerations, the legs' F_r included."""
    # (32) at zero accelerations, moved to one side: rows F = right, the platform feels rows F - right.
    still = motion._replace(ddC_p=(0.0, 0.0, 0.0), dw_p=(0.0, 0.0, 0.0))
    loads = [planar_loads(P.leg, k, P.g) for k in legs]
    rows, right = planar_platform_equations(P, still, legs, loads)
    forces = []
    for row, b in zip(rows, right, strict=True):
        force = -b
        for coefficient, F_i in zip(row, F, strict=True):
            force = force + coefficient * F_i
        forces.append(force)
    n = P.equations
    diagonal = (P.m_p, P.m_p, P.J_pz)[:n]
    return [[diagonal[i] if i == j else 0.0 for j in range(n)] for i in range(n)], forces


def planar_reduced_equations(
    P: PlanarParameters, motion: PlatformMotion, legs: Sequence[PlanarLegState], F: Sequence[Scalar]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Second problem: three equations in (x_p'', y_p'', alpha''), two for a point mass; symmetric positive definite.

    Regular for collinear legs.  ``legs`` at zero accelerations of the platform, which ``motion`` need not hold.
    """
    rows, right = planar_bordered(P, motion, legs, F)
    for k in legs:
        J_q, _, _ = inertia(P.leg, k.q_s)
        for factor, n in ((J_q / (k.L * k.L), (k.c, k.s)), (P.leg.m_s, (-k.s, k.c))):
            d = planar_screw(k, n)[: len(rows)]
            rows = [
                [a + factor * (d_i * d_j) for a, d_j in zip(row, d, strict=True)]
                for row, d_i in zip(rows, d, strict=True)
            ]
    return rows, right


def planar_paper_equations(
    P: PlanarParameters, motion: PlatformMotion, legs: Sequence[PlanarLegState], F: Sequence[Scalar]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Second problem as the paper has it: (32) or (35), and (34) or (36) differentiated twice.

    2N + 3 equations (2N + 2 for a point mass) in (x_p'', y_p'', alpha''; q_n'', q_s'' of each leg); the loads (33) are
    those of q_n'' = q_s'' = 0 with the factors of q_n'', q_s'' beside the platform's columns.
    """
    held = [k._replace(ddq_s=0.0, ddq_n=0.0, A_y=-k.L * k.dq_n * k.dq_n) for k in legs]
    rows, right = planar_bordered(P, motion, held, F)
    n = len(rows)
    w = motion.w_p[2]
    loops: list[list[Scalar]] = []
    for i, k in enumerate(held):
        J_q, _, _ = inertia(P.leg, k.q_s)
        x_n, y_n = (k.c, k.s), (-k.s, k.c)
        for factor, axis in ((-J_q / k.L, x_n), (P.leg.m_s, y_n)):
            for row, d in zip(rows, planar_screw(k, axis), strict=False):
                row.append(factor * d)
        for j, e in enumerate(((1.0, 0.0), (0.0, 1.0))):
            row = [*planar_screw(k, e)[:n], *(0.0 for _ in range(2 * len(held)))]
            row[n + 2 * i : n + 2 * i + 2] = [k.L * x_n[j], -y_n[j]]
            loops.append(row)
            right.append(-2.0 * k.dq_s * k.dq_n * x_n[j] - k.L * k.dq_n * k.dq_n * y_n[j] + w * w * k.r[j])
    return [*rows, *loops], right


def planar_energy(P: PlanarParameters, motion: PlatformMotion, legs: Sequence[PlanarLegState]) -> tuple[Scalar, Scalar]:
    """Kinetic and potential energy [J] of platform and legs, without the heights of the hull pins."""
    (dx, dy, _), w = motion.dC_p, motion.w_p[2]
    T = 0.5 * P.m_p * (dx * dx + dy * dy)
    if P.J_pz is not None:
        T = T + 0.5 * P.J_pz * w * w
    V = -P.m_p * (P.g[0] * motion.C_p[0] + P.g[1] * motion.C_p[1])
    for k in legs:
        J_q, _, m_q = inertia(P.leg, k.q_s)
        T = T + 0.5 * (J_q * k.dq_n * k.dq_n + P.leg.m_s * k.dq_s * k.dq_s)
        V = V - m_q * (P.g[1] * k.c - P.g[0] * k.s)
    return T, V


# --- The second problem of dynamics -----------------------------------------------------------------------------------
#
# Driving forces, pose and twist are given; ddC_p, dw_p are wanted, for any number N >= 1 of legs.  Three forms of the
# same equations (7), (8), (31).  All are linear in the accelerations, so that the terms free of them come from the
# formulas above with the accelerations put to zero.

ZERO: Vector = (0.0, 0.0, 0.0)


class SecondProblem(NamedTuple):
    """Accelerations of the platform, world axes [m/s^2, rad/s^2].

    ``unknowns``: all that the form solved for; ``legs``: at zero accelerations.
    """

    ddC_p: Vector
    dw_p: Vector
    unknowns: Sequence[Scalar]
    legs: Sequence[Any]  # LegState, or PlanarLegState


Equations: TypeAlias = Callable[[Any, PlatformMotion, Any, Sequence[Scalar]], tuple[list[list[Scalar]], list[Scalar]]]
"""``equations(P, motion, legs, F)``: rows and right side, spatial or planar."""


def held_legs(P: Parameters, motion: PlatformMotion, sqrt: Sqrt) -> tuple[PlatformMotion, list[LegState]]:
    """The motion and its legs with ddC_p = dw_p = 0; accelerations in ``motion`` are not read."""
    held = motion._replace(ddC_p=ZERO, dw_p=ZERO)
    return held, [leg_kinematics(P.leg, p, O, held, sqrt) for p, O in zip(P.p, P.O, strict=True)]


def screw(k: LegState, n: Vector) -> tuple[Scalar, ...]:
    """(n, r x n): a unit force along n at the pin, about C_p; and n . (dC_p + w_p x r) as a row in (dC_p, w_p)."""
    return (*n, *cross(k.r, n))


def platform_inertia(P: Parameters, motion: PlatformMotion) -> list[list[Scalar]]:
    """diag(m_p E, R I_p R^T), 6 x 6 [kg, kg m^2], world axes."""
    I_W = [apply(motion.R, apply(P.I_p, row)) for row in motion.R]  # symmetric: its rows are its columns
    m_p = P.m_p
    return [
        [m_p, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, m_p, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, m_p, 0.0, 0.0, 0.0],
        *([0.0, 0.0, 0.0, *row] for row in I_W),
    ]


def platform_forces(P: Parameters, motion: PlatformMotion) -> list[Scalar]:
    """Gravity, load and -w_p x (I_p w_p) on the platform at zero accelerations: six numbers [N, N m], about C_p."""
    force, moment = outside_wrench(P, motion)
    return [*add(mul(P.m_p, P.g), force), *sub(moment, platform_momentum_rate(P, motion))]


def tip_inertia(leg: Leg, k: LegState) -> Vector:
    """What resists the tip along x_n, y_n [kg] and what yields along z_n [1/kg], from (1)-(5).

    F_r = (J_q/L^2) (A . x_n) x_n + m_s (A . y_n) y_n + (A . z_n)/compliance z_n + terms without A.  The third number is
    the inverse, L^2 s^2/(J_q s^2 + J_oz + J_y c^2): a vertical leg with base or spin inertia does not yield at all.
    """
    J_q, J_y, _ = inertia(leg, k.q_s)
    LL = k.L * k.L
    if not leg.spins:
        return J_q / LL, leg.m_s, LL / J_q
    ss = k.s * k.s
    return J_q / LL, leg.m_s, LL * ss / (J_q * ss + leg.J_oz + J_y * k.c * k.c)


class Bordered(NamedTuple):
    """Rows (6 x 6) and right side (6) of the platform with what the legs add along x_n and y_n; the rest per leg.

    ``z``: screw of z_n; ``compliance`` [1/kg] along it; ``f``: z_n . F_r [N] at zero accelerations.
    """

    rows: list[list[Scalar]]
    right: list[Scalar]
    z: list[tuple[Scalar, ...]]
    compliance: list[Scalar]
    f: list[Scalar]


def plus_dyad(rows: list[list[Scalar]], k: Scalar, d: Sequence[Scalar]) -> list[list[Scalar]]:
    """Matrix + k d d^T."""
    return [[a + k * (d_i * d_j) for a, d_j in zip(row, d, strict=True)] for row, d_i in zip(rows, d, strict=True)]


def bordered(P: Parameters, motion: PlatformMotion, legs: Sequence[LegState], F: Sequence[Scalar]) -> Bordered:
    """(15) with (1): what the two forms without joint coordinates share. ``motion``, ``legs``: zero accelerations."""
    rows, right = platform_inertia(P, motion), platform_forces(P, motion)
    z, compliance, f = [], [], []
    for k, F_i in zip(legs, F, strict=True):
        load = leg_loads(P.leg, k, P.g)
        lam_x, lam_y, yields = tip_inertia(P.leg, k)
        rows = plus_dyad(plus_dyad(rows, lam_x, screw(k, k.x_n)), lam_y, screw(k, k.y_n))
        F_r = joint_reaction_r(k, load._replace(M_io_s=0.0), F_i - load.F_is)  # (1) without its part along z_n
        right = [b - d for b, d in zip(right, (*F_r, *cross(k.r, F_r)), strict=True)]
        z.append(screw(k, k.z_n))
        compliance.append(yields)
        f.append(load.M_io_s / k.L)
    return Bordered(rows, right, z, compliance, f)


def reduced_equations(
    P: Parameters, motion: PlatformMotion, legs: Sequence[LegState], F: Sequence[Scalar]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Six equations in (ddC_p, dw_p), symmetric positive definite: (15) with (1) and the tips' accelerations in it.

    Regular in parallel singularities of (7), (8).  A steep leg with base or spin inertia is stiff as 1/s^2.
    """
    rows, right, z, compliance, f = bordered(P, motion, legs, F)
    for d, C, f_i in zip(z, compliance, f, strict=True):
        rows = plus_dyad(rows, 1.0 / C, d)
        right = [b - f_i * x for b, x in zip(right, d, strict=True)]
    return rows, right


def compliance_equations(
    P: Parameters, motion: PlatformMotion, legs: Sequence[LegState], F: Sequence[Scalar]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """6 + N equations in (ddC_p, dw_p, f_1 .. f_N), f = z_n . F_r [N]: regular for vertical legs too.

    The row of a leg is z_n . (ddC_p + dw_p x r) = compliance (f - f at zero accelerations).  At s = 0 with base or
    spin inertia the compliance is 0, and the row holds the tip on the base's x_n y_n plane; 1/s is left in q_o' alone,
    which at rest is 0.  Without that inertia nothing is divided by s.
    """
    rows, right, z, compliance, f = bordered(P, motion, legs, F)
    N = len(z)
    rows = [[*row, *(d[j] for d in z)] for j, row in enumerate(rows)]
    for i, (d, C) in enumerate(zip(z, compliance, strict=True)):
        rows.append([*d, *(-C if j == i else 0.0 for j in range(N))])
        right.append(-C * f[i])
    return rows, right


def joint_inertia(leg: Leg, k: LegState) -> Vector:
    """Inertia of a leg in q_o [kg m^2], q_n [kg m^2], q_s [kg]: the factors of q'' in (22), (21), (20)."""
    J_q, J_y, _ = inertia(leg, k.q_s)
    return leg.J_oz + J_q * k.s * k.s + J_y * k.c * k.c, J_q, leg.m_s


def loop_columns(k: LegState) -> tuple[Vector, Vector, Vector]:
    """Derivatives of L y_n by q_o, q_n [m/rad] and q_s [1]: the legs' part of (31) differentiated."""
    return mul(k.L * k.s, k.z_n), mul(-k.L, k.x_n), k.y_n


def loop_rows(legs: Sequence[LegState]) -> list[list[Scalar]]:
    """(31) differentiated, dC_p + w_p x r - (L y_n)': 3N rows in (dC_p, w_p; q_o', q_n', q_s' of each leg)."""
    rows = []
    for i, k in enumerate(legs):
        columns = loop_columns(k)
        for j, e in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
            row = [*screw(k, e), *(0.0 for _ in range(3 * len(legs)))]
            row[6 + 3 * i : 9 + 3 * i] = [-column[j] for column in columns]
            rows.append(row)
    return rows


def loop_gap(k: LegState, O: Vector, motion: PlatformMotion) -> tuple[Vector, Vector]:
    """C_p + r - O - L y_n [m], the gap of (31), and its rate [m/s], of a leg known by its joint coordinates."""
    gap = sub(add(sub(motion.C_p, O), k.r), mul(k.L, k.y_n))
    dL_y_n = in_world(k, -k.L * k.dq_n, k.dq_s, k.L * k.w)
    return gap, sub(add(motion.dC_p, cross(motion.w_p, k.r)), dL_y_n)


def paper_equations(
    P: Parameters, motion: PlatformMotion, legs: Sequence[LegState], F: Sequence[Scalar]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """3N + 6 equations in (ddC_p, dw_p; q_o'', q_n'', q_s'' of each leg): (7), (8) and (31) differentiated twice.

    Rows of ``loop_rows`` follow the six of (7), (8); the loads are (2)-(4) as printed.  Of ``motion`` and ``legs``
    accelerations are not read.  Divided by s: q_o'' is an unknown.
    """
    rows, right = platform_inertia(P, motion), platform_forces(P, motion._replace(ddC_p=ZERO, dw_p=ZERO))
    right_31: list[Scalar] = []
    for k, F_i in zip(legs, F, strict=True):
        h = HingeRates(dq_o=k.w / k.s, ddq_o=0.0, ddq_n=0.0, e=0.0)
        k_0 = k._replace(ddq_s=0.0)
        load = leg_loads_printed(P.leg, k_0, h, P.g)
        F_r = joint_reaction_r(k, load, F_i - load.F_is)
        right = [b - d for b, d in zip(right, (*F_r, *cross(k.r, F_r)), strict=True)]
        J_o, J_n, m_s = joint_inertia(P.leg, k)
        # F_r is -(M_in/L) x_n + (F_is - F) y_n + (M_io/(s L)) z_n, (1)
        for factor, n in ((J_o / (k.s * k.L), k.z_n), (-J_n / k.L, k.x_n), (m_s, k.y_n)):
            for row, d in zip(rows, screw(k, n), strict=True):
                row.append(factor * d)
        ddL_y_n = second_derivative_along(k_0, h, k.L, k.dq_s, 0.0)
        right_31 += sub(ddL_y_n, cross(motion.w_p, cross(motion.w_p, k.r)))
    return [*rows, *loop_rows(legs)], [*right, *right_31]


def leg_from_joints(
    leg: Leg, r: Vector, sines: tuple[Scalar, Scalar, Scalar, Scalar], q_s: Scalar, rates: Vector
) -> LegState:
    """A leg from its joint coordinates, loop open or closed: ``sines`` so, co, s, c; ``rates`` q_o', q_n', q_s'.

    Its accelerations are those of q_o'' = q_n'' = q_s'' = 0.
    """
    so, co, s, c = sines
    dq_o, dq_n, dq_s = rates
    x_n, y_n, z_n = leg_axes(so, co, s, c)
    L, w = q_s + leg.a, s * dq_o
    return LegState(
        r=r, L=L, q_s=q_s, so=so, co=co, s=s, c=c, x_n=x_n, y_n=y_n, z_n=z_n, dq_s=dq_s, dq_n=dq_n, w=w,
        ddq_s=0.0, u=2.0 * c * dq_n * dq_o, nu=-s * c * dq_o * dq_o, A_y=-L * (w * w + dq_n * dq_n),
    )  # fmt: skip


def second_problem(
    P: Parameters, motion: PlatformMotion, F: Sequence[Scalar], sqrt: Sqrt, solve: Solve, equations: Equations
) -> SecondProblem:
    """Forward dynamics: F, pose and twist are given, the platform's accelerations are wanted.

    The legs' accelerations follow from `leg_kinematics` and `hinge_rates` with ddC_p, dw_p in the motion.

    Parameters
    ----------
    P, motion
        Numbers of any one kind; the motion's accelerations are not read.
    F
        N driving forces [N].
    sqrt, solve
        Square root of that kind; ``solve(rows, right)``.
    equations
        `compliance_equations`, `reduced_equations` or `paper_equations`.
    """
    held, legs = held_legs(P, motion, sqrt)
    x = solve(*equations(P, held, legs, F))
    return SecondProblem((x[0], x[1], x[2]), (x[3], x[4], x[5]), x, legs)


def planar_second_problem(
    P: PlanarParameters, motion: PlatformMotion, F: Sequence[Scalar], sqrt: Sqrt, solve: Solve, equations: Equations
) -> SecondProblem:
    """As `second_problem`, by `planar_reduced_equations` or `planar_paper_equations`; zeros off the plane."""
    held = motion._replace(ddC_p=ZERO, dw_p=ZERO)
    legs = [planar_leg_kinematics(P.leg, p, O, held, sqrt) for p, O in zip(P.p, P.O, strict=True)]
    x = solve(*equations(P, held, legs, F))
    zero = 0.0 * x[0]
    return SecondProblem((x[0], x[1], zero), (zero, zero, zero if P.J_pz is None else x[2]), x, legs)


# --- Energy -----------------------------------------------------------------------------------------------------------


def energy(P: Parameters, motion: PlatformMotion, legs: Sequence[LegState]) -> tuple[Scalar, Scalar]:
    """Kinetic and potential energy of platform and legs [J].  Accelerations are not read.

    The potential leaves out what never changes: the heights of the hull pins.
    """
    w_P = apply_transposed(motion.R, motion.w_p)
    T = 0.5 * (P.m_p * dot(motion.dC_p, motion.dC_p) + dot(w_P, apply(P.I_p, w_P)))
    V = -P.m_p * dot(P.g, motion.C_p)
    for k in legs:
        J_q, J_y, m_q = inertia(P.leg, k.q_s)
        T = T + 0.5 * (J_q * (k.w * k.w + k.dq_n * k.dq_n) + P.leg.m_s * k.dq_s * k.dq_s)
        if P.leg.spins:
            dq_o = k.w / k.s
            T = T + 0.5 * (P.leg.J_oz + J_y * k.c * k.c) * dq_o * dq_o
        V = V - m_q * dot(P.g, k.y_n)
    return T, V


def power(
    P: Parameters | PlanarParameters,
    motion: PlatformMotion,
    legs: Sequence[LegState] | Sequence[PlanarLegState],
    F: Sequence[Scalar],
) -> tuple[Scalar, Scalar]:
    """Power of the driving forces, sum F_i L_i', and of the load on the platform [W]."""
    force, moment = outside_wrench(P, motion)
    actuators = 0.0
    for k, F_i in zip(legs, F, strict=True):
        actuators = actuators + F_i * k.dq_s
    return actuators, dot(force, motion.dC_p) + dot(moment, motion.w_p)
