# %% [markdown]
# # The propeller model in sixty lines
# Runs as a script (`.venv/bin/python examples/propeller_tour.py [picture.png]`) and, cell by cell,
# in Jupyter (jupytext), VS Code or Spyder. SI units; speeds in rad/s, `RPM` converts.

# %%
import sys

import numpy as np
from matplotlib.figure import Figure

from tombo_dynamics.propeller import RPM, evaluate, thrust_peak

# %% One operating point: configuration 13 of the paper at 2000 rpm
point = evaluate(13, 2000 * RPM)
print(f"thrust {point.thrust_N:.3f} N, twist {np.degrees(point.gamma_rad):.2f} deg")

# %% A grid: speeds on a warm and on a cold day; shapes broadcast as numpy's do
speeds = np.linspace(0, 9000, 91) * RPM
grid = evaluate(13, speeds, air_density_kg_m3=[[1.1], [1.3]])
print(grid, ", ".join(grid.table()))  # pandas.DataFrame(grid.table())

# %% Another nodus, and which speed lifts 1.2 kg with four such propellers
for length in (12.0, 10.0):
    thrust = evaluate(13, speeds, length_mm=length).thrust_N
    print(f"{length:g} mm, hover: {np.interp(1.2 * 9.81 / 4, thrust, speeds) / RPM:.0f} rpm")

# %% A million propellers in one call: nodus length and fibres at random, thrust where it is valid
rng = np.random.default_rng(0)
many = evaluate(
    13,
    4674 * RPM,
    outside="mask",
    length_mm=rng.normal(12.0, 0.5, 1_000_000),
    fibre_diameter_mm=rng.normal(0.9, 0.02, 1_000_000),
)
print(f"fabrication: {np.nanmean(many.thrust_N):.3f} +- {np.nanstd(many.thrust_N):.3f} N")

# %% A figure: how the nodus' length sets the most thrust there is
length = np.linspace(6, 20, 57)
figure = Figure(figsize=(7.0, 4.0), layout="constrained")
axes = figure.subplots()
for matrix in ("DragonSkin10", "DragonSkin20", "DragonSkin30"):
    peak = thrust_peak(13, matrix=matrix, length_mm=length)
    rises = np.where(peak.has_maximum, peak.thrust_N, np.nan)
    axes.plot(length, rises, label=matrix)
axes.axhline(1.2 * 9.81 / 4, color="0.5", linestyle="--", label="hover of 1.2 kg")
axes.set(xlabel="length of the nodus [mm]", ylabel="largest thrust [N]", ylim=(0, None))
axes.set_title("The harder silicones carry a quadrotor with margin (law repaired, not validated)")
axes.legend()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "propeller_tour.png", dpi=120)
