#!/usr/bin/env python3
"""Reference numbers of two rotors by ROSS: `python3 tests/peers/rotors.py`.

Makes a virtual environment in target/peers-rotors and installs ross-rotordynamics 2.3.0 there. Printed per rotor: undamped lateral natural
frequencies (Hz) at standstill and at 1000 rad/s, and the amplitude (m) of the response to an unbalance over the speed at two places, as the
test `oracle_rotors_of_ross` of crates/sim/src/beam/tests.rs has them. Elements are 2.5 mm long: those
of ROSS err with the square of their length, here by up to 3e-5 at 5.6 kHz.
"""

import os
import subprocess
import sys
from pathlib import Path

VERSION = "2.3.0"
VENV = Path(__file__).resolve().parents[2] / "target" / "peers-rotors"
ELEMENT_MM = 2.5
SPEED = 1000.0
UNBALANCE_KG_M = 1e-4
SPEEDS = [100.0, 500.0, 1000.0, 1500.0, 2500.0, 5000.0]

# length, outer and inner diameter (mm); position (mm), stiffness (N/m), damping (N s/m); position (mm), mass (kg), I_d, I_p (kg m2)
ROTORS = {
    "between_bearings": {
        "sections": [(60, 25, 0), (200, 40, 15), (60, 25, 0)],
        "supports": [(20, 1.2e8, 1500.0), (300, 0.9e8, 1000.0)],
        "discs": [(90, 2.0, 2.5e-3, 4.0e-3), (230, 5.0, 1.2e-2, 2.0e-2)],
    },
    "overhung": {
        "sections": [(300, 30, 0)],
        "supports": [(50, 1.5e8, 800.0), (220, 1.0e8, 1200.0)],
        "discs": [(130, 1.5, 1.4e-3, 2.2e-3), (290, 6.0, 2.1e-2, 4.0e-2)],
    },
}


def in_environment():
    """Runs this file again inside the virtual environment, made where it is missing."""
    python = VENV / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(VENV)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", f"ross-rotordynamics=={VERSION}", "plotly<6"], check=True)
    os.execv(str(python), [str(python), __file__, "--inside"])


def main():
    import numpy as np
    import ross as rs

    assert rs.__version__ == VERSION, rs.__version__
    steel = rs.Material(name="steel", rho=7850.0, E=2.06e11, Poisson=0.3)
    for name, spec in ROTORS.items():
        shaft = []
        for length, outer, inner in spec["sections"]:
            shaft += [
                rs.ShaftElement(L=1e-3 * ELEMENT_MM, idl=1e-3 * inner, odl=1e-3 * outer, material=steel, shear_effects=True,
                                rotary_inertia=True, gyroscopic=True, shear_method_calc="cowper")
                for _ in range(round(length / ELEMENT_MM))
            ]
        node = lambda mm: round(mm / ELEMENT_MM)
        discs = [rs.DiskElement(n=node(at), m=m, Id=i_d, Ip=i_p) for at, m, i_d, i_p in spec["discs"]]

        def rotor(damped):
            bearings = [rs.BearingElement(n=node(at), kxx=k, cxx=c if damped else 0.0) for at, k, c in spec["supports"]]
            return rs.Rotor(shaft, discs, bearings)

        print(name)
        undamped = rotor(False)
        # Deflections and slopes alone: ROSS has the shaft's axial and torsional motion in the same matrices.
        lateral = [i for i in range(undamped.ndof) if i % 6 in (0, 1, 3, 4)]
        pick = np.ix_(lateral, lateral)
        for speed in [0.0, SPEED]:
            m, k = undamped.M(speed)[pick], undamped.K(speed)[pick]
            g = undamped.G()[pick] * speed
            n = len(lateral)
            a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(m, k), -np.linalg.solve(m, g)]])
            hz = np.sort(np.abs(np.linalg.eigvals(a).imag)) / (2 * np.pi)
            print(f"  at {speed} rad/s:", ", ".join(f"{f:.6f}" for f in hz[::2][:12]))
        at, probe = spec["discs"][1][0], [spec["discs"][0][0], spec["supports"][1][0]]
        response = rotor(True).run_unbalance_response(node(at), UNBALANCE_KG_M, 0.0, SPEEDS)
        for mm in probe:
            amplitude = np.abs(response.forced_resp[6 * node(mm)])
            print(f"  unbalance at {at} mm, seen at {mm} mm:", ", ".join(f"{x:.6e}" for x in amplitude))


if __name__ == "__main__":
    main() if "--inside" in sys.argv else in_environment()
