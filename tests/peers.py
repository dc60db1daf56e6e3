"""Other programs that answer the same question, called with our inputs."""

import numpy as np


def shipmmg(mmg, time, delta, shaft, speed, **solver):
    """Rows u, v, r, x, y, psi of the solution for an Mmg at `time` (n) [s], rudder `delta` (n) [rad], shaft speed, from a straight `speed`.

    Its parameter objects are filled from the dimensionless coefficients; `solver` are options of its solve_ivp.
    """
    from shipmmg import mmg_3dof as peer

    L, mass, unit = mmg.Lpp, mmg.rho * mmg.nabla, 0.5 * mmg.rho * mmg.Lpp**2 * mmg.d
    basic = {
        "L_pp": L,
        "B": np.nan,
        "d": mmg.d,
        "x_G": mmg.x_G,
        "D_p": mmg.D_P,
        "m": mass,
        "A_R": mmg.A_R,
        "I_zG": mass * (mmg.kzz * L) ** 2,
        "m_x": mmg.m_x * unit,
        "m_y": mmg.m_y * unit,
        "J_z": mmg.J_z * unit * L**2,
        "η": mmg.D_P / mmg.H_R,
        "f_α": mmg.f_alpha,
        "\u03b5": mmg.epsilon,
        "t_R": mmg.t_R,
        "x_R": mmg.x_R * L,
        "a_H": mmg.a_H,
        "x_H": mmg.x_H * L,
        "γ_R_minus": mmg.gamma_R_minus,
        "γ_R_plus": mmg.gamma_R_plus,
        "l_R": mmg.l_R,
        "κ": mmg.kappa,
        "t_P": mmg.t_P,
        "w_P0": mmg.w_P0,
        "x_P": mmg.x_P,
    }
    names = peer.Mmg3DofManeuveringParams.__dataclass_fields__
    hull = {name: getattr(mmg, name.replace("k_", "k").replace("_dash", "")) for name in names}
    solution = peer.simulate_mmg_3dof(
        peer.Mmg3DofBasicParams(**basic),
        peer.Mmg3DofManeuveringParams(**hull),
        *(time, delta, np.full(len(time), shaft)),
        u0=speed,
        ρ=mmg.rho,
        **solver,
    )
    return solution.sol(time)
