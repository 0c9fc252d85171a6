"""
Your part in ten minutes
========================

From a mesh file to a report that can be sent on. All of this is also one line a step in a shell:
``skfem-peridynamics info part.msh``, ``init --from part.msh``, ``check part.toml``, ``run part.toml -o out --report``.
"""

# %%
# A mesh comes from a mesher: Gmsh, Abaqus, whatever meshio reads. So that this page needs none, scikit-fem makes one
# here, with a name for each side, and it is written as a file.
import tempfile
from pathlib import Path

import meshio
import numpy as np
import skfem

import skfem_peridynamics as peri

folder = Path(tempfile.mkdtemp())
axes = np.linspace(0.0, 40.0, 81), np.linspace(0.0, 20.0, 41)
box = skfem.MeshTri.init_tensor(*axes).with_boundaries({"top": lambda x: x[1] == 20.0, "bottom": lambda x: x[1] == 0.0})
lines = {name: box.facets[:, facets].T for name, facets in box.boundaries.items()}
cells = [("triangle", box.t.T), *(("line", ends) for ends in lines.values())]
tags = [np.full(box.nelements, 1), np.full(len(lines["top"]), 2), np.full(len(lines["bottom"]), 3)]
part = meshio.Mesh(
    np.pad(box.p.T, ((0, 0), (0, 1))),
    cells,
    cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
    field_data={"glass": [1, 2], "top": [2, 1], "bottom": [3, 1]},
)
meshio.write(folder / "part.msh", part, file_format="gmsh22", binary=False)

# %%
# What does the file have? ``info`` tells the sizes, the named groups, and a horizon to begin with: four vertices long,
# from where on the toughness of a crack is right.
from skfem_peridynamics.app.cli import main

_ = main(["info", str(folder / "part.msh"), "--scale", "1e-3"])

# %%
# A scene says everything else. ``init`` writes one with the groups of the mesh filled in and a comment beside each key;
# this is what is left of it when it has been edited: glass, torn apart by its top and bottom, with a slit to begin at.
(folder / "part.toml").write_text("""
title = "My part"
units = { length = "m", force = "N", time = "s" }

[mesh]
file = "part.msh"
scale = 1e-3                     # the file is in millimetres

[material]                       # soda-lime glass
young = 72e9
toughness = 135.0
density = 2440.0
plane = "stress"

[bonds]
horizon = 2.0e-3

[[crack]]
points = [[0.0, 0.01], [0.01, 0.01]]

[[load]]                         # at once, through a layer of one horizon
traction = [0.0, 14e6]
on = "top"
layer = 2e-3

[[load]]
traction = [0.0, -14e6]
on = "bottom"
layer = 2e-3

[[no_fail]]                      # where the load bites, nothing breaks
on = "top"
width = 2e-3

[[no_fail]]
on = "bottom"
width = 2e-3

[time]
until = 16e-6

[output]
frames = 4
fields = ["stress"]
""")

# %%
# ``check`` tells the cost before anything runs, and all mistakes together where there are any.
_ = main(["check", str(folder / "part.toml")])

# %%
# Now the run. The command line shows a bar meanwhile, and so does ``progress=True`` here.
done = peri.run(peri.Scene.read(folder / "part.toml"), folder / "out", with_report=True)
print(done.headline)
print(f"energy off by {done['energy_drift']:.1e} of its peak; {sum(done['seconds'].values()):.0f} s")
done

# %%
# What is left of the glass, on its deformed shape:
import matplotlib.pyplot as plt

figure, above = plt.subplots(figsize=(7, 3.5), layout="constrained")
done.plot(scale=20, ax=above)
figure.colorbar(above.collections[0], label="bonds gone, fraction")
above.set_title(f"{done['softened_bonds']} softened bonds, displacements 20 times")

# %%
# The report is one file that opens offline. ``frames.pvd`` is for ParaView, ``history.csv`` for a spreadsheet.
print(sorted(path.name for path in done.folder.iterdir()))
