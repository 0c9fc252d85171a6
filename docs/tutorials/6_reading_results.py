"""
Reading results: ParaView, pyvista, arrays
==========================================

A run leaves ``frames.pvd`` for ParaView (File, Open, Apply; colour by ``damage``) and arrays for Python.
"""

# %%
# A block in space is torn by its ends.
import tempfile

import skfem_peridynamics as peri

scene = peri.Scene.parse("""
title = "block"
mesh = { box = [[0, 2], [0, 1], [0, 1]], divisions = [12, 6, 6] }
material = { young = 1.0, toughness = 2e-4, density = 1.0 }
bonds = { horizon = 0.5 }
crack = [{ points = [[1, 0, 0], [1, 0.5, 0], [1, 0.5, 1], [1, 0, 1]] }]
initial = { velocity = ["0.01 * (x - 1)", "0", "0"] }
time = { until = 8.0 }
output = { frames = 3, pictures = false }
""")
done = peri.run(scene, tempfile.mkdtemp())
print(done.headline)

# %%
# Frames are read when they are asked for.
frame = done.frames[-1]
print(f"t = {frame.t:g}, {frame.mesh.nvertices} vertices, fields {', '.join(sorted(frame.fields))}")
print(f"largest displacement {abs(frame.fields['displacement']).max():.3f}, most bonds gone {frame.broken.max():.2f}")

# %%
# The columns of the history are arrays by name.
for name in ("t", "total", "softened_bonds"):
    if name in done.history:
        print(f"{name}: {done.history[name][-1]:.4g} at the end")

# %%
# ``peri.view`` gives pyvista's plotter: the crack's surface in a body that is seen through; ``.show()`` opens it, in a
# window or a notebook. A picture of it is drawn where pyvista (the extra ``view``) is installed.
import importlib.util

if importlib.util.find_spec("pyvista") is None:
    print("pip install 'skfem-peridynamics[view]'")
else:
    import matplotlib.pyplot as plt

    u = frame.fields["displacement"].ravel()
    plotter = peri.view(frame.mesh, u, fields=frame.fields, off_screen=True, window_size=(900, 500))
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    figure, above = plt.subplots(figsize=(7, 3.9), layout="constrained")
    above.imshow(picture)
    above.set_axis_off()
