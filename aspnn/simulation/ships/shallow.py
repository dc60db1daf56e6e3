"""A ship of the MMG method in shallow water: its coefficients, corrected for the depth.

Derivatives and added masses: M. Taimuri et al. (2020), doi 10.1016/j.oceaneng.2020.108103, after Ankudinov et al. (1990);
resistance: Y. Furukawa et al. (2016), doi 10.18451/978-3-939230-38-0_33; thrust deduction, wake and flow straightening: Tang
et al. (2020), doi 10.1016/j.oceaneng.2019.106679. All taken from a public transcription (mmgdynamics), the primaries not read.
"""

import math

from aspnn.schema import InputError
from aspnn.simulation.ships.mmg import Mmg

# Depth over draught: the shallowest that KVLCC2 was tested at for SIMMAN (cases 2.1 and 2.2). Assumed; the sources' own was not read.
SHALLOWEST = 1.2
WIDEST = 4.0  # beam over draught up to which the factors' K_2 holds
_CUBIC = ("X_vv", "X_vvvv", "Y_v", "Y_vvv", "Y_vvr", "Y_vrr", "N_vvv", "N_vvr", "N_vrr")


def factors(L: float, B: float, d: float, C_b: float, depth: float) -> dict[str, float]:
    """What the coefficients (by name) of a ship of length L, beam B, draught d [m] and block coefficient C_b are multiplied by.

    With F = depth / d - 1 and b = C_b B (1 + B / L)^2 / d (B_1 / T of the source):
    K_0 = 1 + 0.0775 / F^2 - 0.0110 / F^3 + 0.000068 / F^5,
    K_1 = -0.0643 / F + 0.0724 / F^2 - 0.0113 / F^3 + 0.0000767 / F^5, K_2 = 0.0342 / F (B / d <= 4).
    m_y: K_0 + 2/3 K_1 b + 8/15 K_2 b^2. J_z, Y_rrr, N_rrr: K_0 + 8/15 K_1 b + 40/105 K_2 b^2. Y_r, X_vr: K_0 + 2/5 K_1 b +
    24/105 K_2 b^2. N_r, X_rr: f = K_0 + 1/2 K_1 b + 1/3 K_2 b^2. N_v: K_0 + K_1 b + K_2 b^2. Y_v and the terms of the third order
    with v: 3/2 f - 1/2. R_0: 1 + 0.388 (d / depth)^2. gamma_R: 1 + 0.0161 q + 4.4222 q^2 - 4.9825 q^3, q = d / depth.
    The transcription has every factor, but leaves the added masses alone and takes Y_v, Y_r, N_r, N_vvr and N_vrr from another
    regression. Here the family stays whole, since the other one's cubics in q (Y_r, N_vvr, N_vrr) change sign for cargo90. Recalled:
    which factors are those of m_y, J_z, Y_v, Y_r and N_r; the other regression's Y_v agrees within 30 % (tests). Assumed:
    N_vvr and N_vrr as the other terms of the third order; m_x, a twentieth of the mass, stays (the formula found turns
    negative for slender hulls).
    """
    F, q = depth / d - 1, d / depth
    b = C_b * B * (1 + B / L) ** 2 / d
    K_0 = 1 + 0.0775 / F**2 - 0.0110 / F**3 + 0.000068 / F**5
    K_1 = (-0.0643 / F + 0.0724 / F**2 - 0.0113 / F**3 + 0.0000767 / F**5) * b
    K_2 = 0.0342 / F * b**2
    rotation = K_0 + K_1 / 2 + K_2 / 3
    swayed = dict.fromkeys(_CUBIC, 1.5 * rotation - 0.5)
    turned = dict.fromkeys(("J_z", "Y_rrr", "N_rrr"), K_0 + 8 / 15 * K_1 + 40 / 105 * K_2)
    straightened = dict.fromkeys(("gamma_R_plus", "gamma_R_minus"), 1 + 0.0161 * q + 4.4222 * q**2 - 4.9825 * q**3)
    return {
        **swayed,
        **turned,
        **straightened,
        "m_y": K_0 + 2 / 3 * K_1 + 8 / 15 * K_2,
        "Y_r": K_0 + 2 / 5 * K_1 + 24 / 105 * K_2,
        "X_vr": K_0 + 2 / 5 * K_1 + 24 / 105 * K_2,
        "N_r": rotation,
        "X_rr": rotation,
        "N_v": K_0 + K_1 + K_2,
        "R_0": 1 + 0.388 * q**2,
    }


def shallow(mmg: Mmg, beam: float, depth: float) -> Mmg:
    """The ship in water of constant `depth` [m]; `beam` [m]. Infinite depth changes nothing.

    The coefficients times their `factors`; (1 - t_P) / (1 - 0.2 q + 0.7295 q^2) and (1 - w_P0) cos(1.4 C_b q), q = d / depth.
    Domain: depth over draught from 1.2, beam over draught to 4, slow enough for resistance without the waves of shallow water
    (a depth Froude number U / sqrt(g depth) below about 0.5). Squat, banks and a sloping bottom are not in it.
    Raises InputError outside the first two.
    """
    if not depth / mmg.d >= SHALLOWEST:
        raise InputError(
            f"depth {depth:g} m is {depth / mmg.d:.3g} of the draught {mmg.d:g} m, below the {SHALLOWEST:g} of the shallow-water"
            f" corrections; take at least {SHALLOWEST * mmg.d:.3g} m"
        )
    if beam / mmg.d > WIDEST:
        raise InputError(
            f"beam {beam:g} m is {beam / mmg.d:.3g} of the draught {mmg.d:g} m, above the {WIDEST:g} of the shallow-water"
            f" corrections; simulate this ship in deep water"
        )
    C_b, q = mmg.nabla / (mmg.Lpp * beam * mmg.d), mmg.d / depth
    found = factors(mmg.Lpp, beam, mmg.d, C_b, depth)
    return mmg._replace(
        **{name: getattr(mmg, name) * factor for name, factor in found.items()},
        t_P=1 - (1 - mmg.t_P) / (1 - 0.2 * q + 0.7295 * q**2),
        w_P0=1 - (1 - mmg.w_P0) * math.cos(1.4 * C_b * q),
    )
