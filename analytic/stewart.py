"""Closed-form dynamics of a Stewart platform whose N legs are made of a base, a guide and a rod.

Voynov, Telegin, Timofeev 2016, DOI 10.14529/ctcr160403: the numbers (1)-(31) and the symbols are the paper's.

One text for every kind of number.  A vector is a tuple of three components; the text uses ``+ - * /`` and a square
root that is passed in, nothing else.  The same lines therefore run on Python floats, on NumPy arrays (samples along
the last axis) and on ball arithmetic; trigonometry never appears, because s, c, s_o, c_o are ratios of lengths.

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


class PlatformMotion(NamedTuple):
    """Pose, twist and acceleration of the platform's centre of mass, world axes. ``R``: rows of R_WP."""

    C_p: Any
    R: Any
    dC_p: Any
    w_p: Any
    ddC_p: Any
    dw_p: Any


class NotDeterminate(ValueError):
    """(7), (8) are six equations for N driving forces: N must be 6. ``determined`` holds what needs no F."""

    def __init__(self, N: int, determined: Any) -> None:
        kind = f"underdetermined: {N - 6} too many unknowns" if N > 6 else f"overdetermined: {6 - N} too many equations"
        super().__init__(
            f"N = {N} legs: (7), (8) are 6 equations for {N} driving forces, {kind}. "
            "F_is, M_in, M_io/s, the components of F_r along x_n and z_n, and M_s, M_n, M_o do not depend on F: "
            "they are in the attribute `determined` of this error"
        )
        self.determined = determined


# --- Vectors ----------------------------------------------------------------------------------------------------------


def add(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    first, *rest = vectors
    for b in rest:
        first = (first[0] + b[0], first[1] + b[1], first[2] + b[2])
    return first


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


def in_world(k: LegState, x: Scalar, y: Scalar, z: Scalar) -> Vector:
    """The vector x x_n + y y_n + z z_n, by (18)."""
    return add(mul(x, k.x_n), mul(y, k.y_n), mul(z, k.z_n))


# --- Statement 1: reaction in the spherical joint, (1)-(5) ------------------------------------------------------------


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


# --- Statement 2: driving forces, (7)-(15) ----------------------------------------------------------------------------


def platform_momentum_rate(P: Parameters, motion: PlatformMotion) -> Vector:
    """(I_p . w_p)'_t [N m], world axes, of (8)."""
    w_P = apply_transposed(motion.R, motion.w_p)
    dw_P = apply_transposed(motion.R, motion.dw_p)
    return apply(motion.R, add(apply(P.I_p, dw_P), cross(w_P, apply(P.I_p, w_P))))


def outside_wrench(P: Parameters, motion: PlatformMotion) -> tuple[Vector, Vector]:
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


def platform_equations_printed(
    P: Parameters, motion: PlatformMotion, legs: Sequence[LegState], loads: Sequence[Loads]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """The scalar 6 x 6 system: x_r, y_r, z_r of (7) and (8) with the coefficients (9)-(14) as printed."""
    rows: list[list[Scalar]] = [[] for _ in range(6)]
    right = [*mul(P.m_p, sub(motion.ddC_p, P.g)), *platform_momentum_rate(P, motion)]
    for k, O, (_, M_in, M_io_s) in zip(legs, P.O, loads, strict=True):
        L, so, co, s, c = k.L, k.so, k.co, k.s, k.c
        xx, xz, yx, yz = co * c, -so * c, -co * s, so * s  # (9)
        x, y, z = sub(O, motion.C_p)  # (10)
        y_x, y_y, y_z = y * yz - z * c, z * yx - x * yz, x * c - y * yx  # (11)
        M_x = (M_in * (y * xz - z * s - L * so) - M_io_s * (y * co + L * xx)) / L  # (12)
        M_y = (M_in * (z * xx - x * xz) - M_io_s * (z * so - x * co + L * s)) / L  # (13)
        M_z = (M_in * (x * s - y * xx - L * co) - M_io_s * (L * xz - y * so)) / L  # (14)
        f = mul(1.0 / L, sub(mul(M_in, k.x_n), mul(M_io_s, k.z_n)))
        for row, value in zip(rows, (yx, c, yz, y_x, y_y, y_z), strict=True):
            row.append(value)
        right = [b - d for b, d in zip(right, (*f, M_x, M_y, M_z), strict=True)]
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


def joint_moments_printed(leg: Leg, k: LegState, h: HingeRates, loads: Loads, g: Vector) -> Moments:
    """(27)-(29) as printed; G z_n of (28) is -m_q y_n x g, which serves any gravity."""
    _, _, m_q = inertia(leg, k.q_s)
    zero = 0.0 * k.L
    y_x_F_r = in_world(k, loads.M_io_s / k.L, zero, loads.M_in / k.L)  # (30)
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


def driven(P: Parameters, motion: PlatformMotion, state: Determined, solve: Solve) -> FirstProblem:
    """Driving forces by (7), (8), then the joint forces (23)-(26). Raises NotDeterminate unless N = 6."""
    legs, loads, moments = state
    if len(legs) != 6:
        raise NotDeterminate(len(legs), state)
    X = solve(*platform_equations(P, motion, legs, loads))
    F = [X_i + load.F_is for X_i, load in zip(X, loads, strict=True)]
    forces = [joint_forces(P.leg, k, load, X_i, P.g) for k, load, X_i in zip(legs, loads, X, strict=True)]
    return FirstProblem(legs, F, forces, moments)


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
    return driven(P, motion, determined(P, motion, sqrt), solve)


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
    legs: list[LegState]


Equations: TypeAlias = Callable[
    [Parameters, PlatformMotion, Sequence[LegState], Sequence[Scalar]], tuple[list[list[Scalar]], list[Scalar]]
]


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
    return [[a + k * d_i * d_j for a, d_j in zip(row, d, strict=True)] for row, d_i in zip(rows, d, strict=True)]


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
    P: Parameters, motion: PlatformMotion, legs: Sequence[LegState], F: Sequence[Scalar]
) -> tuple[Scalar, Scalar]:
    """Power of the driving forces, sum F_i L_i', and of the load on the platform [W]."""
    force, moment = outside_wrench(P, motion)
    actuators = 0.0
    for k, F_i in zip(legs, F, strict=True):
        actuators = actuators + F_i * k.dq_s
    return actuators, dot(force, motion.dC_p) + dot(moment, motion.w_p)
