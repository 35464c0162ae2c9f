"""measured.csv as docs/images/convergence.svg. Needs matplotlib."""

import csv
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

plt.rcParams.update({"svg.hashsalt": "tyndall", "font.size": 9})
here = Path(__file__).parent
with open(here / "measured.csv") as file:
    rows = list(csv.DictReader(file))
titles = {
    "density": "--density (voxels get thinner to the right)",
    "projection-steps": "--projection-steps",
    "gather-step": "--gather-step, voxels",
    "camera-step": "--camera-step, voxels",
    "steps": "both steps, of their defaults",
}
figure, axes = plt.subplots(1, 5, figsize=(13, 2.8), sharey=True, layout="constrained")
for axis, (knob, title) in zip(axes, titles.items()):
    points = [(float(r["value"]), float(r["bias_percent"]), float(r["block_bias_percent"])) for r in rows if r["knob"] == knob]
    x = [p[0] for p in points]
    axis.axhspan(-1, 1, color="0.93")
    axis.axhline(0, color="0.6", linewidth=0.8)
    axis.plot(x, [p[1] for p in points], "o-", label="bias")
    axis.plot(x, [p[2] for p in points], "s--", label="block bias")
    axis.set_xscale("log", base=2)
    axis.set_xticks(x, [f"{v:g}" for v in x])
    axis.minorticks_off()
    if knob != "projection-steps":
        axis.invert_xaxis()
    axis.set_xlabel(title)
axes[0].set_ylabel("multiple against path, %")
axes[0].legend(frameon=False)
figure.savefig(here.parent / "images" / "convergence.svg", metadata={"Date": None})
