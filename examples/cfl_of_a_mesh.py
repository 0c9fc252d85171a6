"""The stable time step of a mesh, four ways, with what each costs in steps.

python examples/cfl_of_a_mesh.py [MESH_FILE HORIZON]
"""

import sys
import time

import skfem

import skfem_peridynamics as peri


def main(mesh: skfem.Mesh | None = None, horizon: float = 0.1) -> dict[str, float]:
    begin = time.perf_counter()
    mesh = skfem.MeshTri.init_circle(5) if mesh is None else mesh
    element = {1: skfem.ElementLineP1, 2: skfem.ElementTriP1, 3: skfem.ElementTetP1}[mesh.dim()]()
    basis = skfem.Basis(mesh, skfem.ElementVector(element))
    plane = "strain" if mesh.dim() == 2 else None
    steel = peri.Material.from_elastic(young=200e9, density=7850.0, plane=plane, potential="linear")
    body = peri.Peridynamics(peri.BondBasis(basis, horizon=horizon), steel)
    limit = peri.stable_time_step(body, peri.mass_matrix(basis, density=steel.density))
    return {
        "vertices": mesh.nvertices,
        "bonds": body.bonds.nbonds,
        "dt": limit.dt,
        **{f"dt by {name.replace('_', ' ')}": dt for name, dt in limit.steps().items()},
        "seconds": time.perf_counter() - begin,
    }


if __name__ == "__main__":
    arguments = (skfem.Mesh.load(sys.argv[1]), float(sys.argv[2])) if len(sys.argv) == 3 else ()
    for name, value in main(*arguments).items():
        print(f"{name:>20}  {value:.6g}")
