# %% [markdown]
# # The propeller model in sixty lines
# Runs as a script (`.venv/bin/python examples/propeller_tour.py [picture.png]`) and, cell by cell,
# in Jupyter (jupytext), VS Code or Spyder. SI units; speeds in rad/s, `RPM` converts.

# %%
import sys
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tombo_dynamics.propeller import (
    RPM,
    SCALARS,
    Configuration,
    Surroundings,
    configuration,
    evaluate,
    evaluate_rows,
    parameter_row,
    read_library,
    speed_of_maximum_thrust,
)

# %% One operating point: configuration 13 of the paper at 2000 rpm
point = evaluate(13, 2000 * RPM)
print(f"thrust {point.thrust_N:.3f} N, twist {np.degrees(point.gamma_rad):.2f} deg")

# %% Over speed, on a warm and on a cold day
speeds = np.linspace(0, 9000, 91) * RPM
for density in (1.1, 1.3):
    day = evaluate(13, speeds, surroundings=Surroundings(air_density_kg_m3=density))
    print(day, ", ".join(day.table()))  # pandas.DataFrame(day.table())


# %% Another nodus, and which speed lifts 1.2 kg with four such propellers
def with_nodus(**changes: Any) -> Configuration:
    """Return configuration 13 with another nodus."""
    paper = configuration(13)
    assert paper.nodus is not None
    return replace(paper, nodus=replace(paper.nodus, **changes))


for length in (12.0, 10.0):
    thrust = evaluate(with_nodus(length_mm=length), speeds).thrust_N
    print(f"{length:g} mm, hover: {np.interp(1.2 * 9.81 / 4, thrust, speeds) / RPM:.0f} rpm")

# %% A million propellers in one call: rows of the law's inputs, the twist's compliance at random
rng = np.random.default_rng(0)
rows = np.tile(parameter_row(configuration(13), "repaired"), (1_000_000, 1))
rows[:, SCALARS["twist_compliance"]] *= rng.normal(1.0, 0.05, len(rows))
many = evaluate_rows(rows, 4674 * RPM, outside="mask")
print(f"fabrication: {np.nanmean(many.thrust_N):.3f} +- {np.nanstd(many.thrust_N):.3f} N")

# %% A figure: how the nodus' length sets the most thrust there is
lengths = np.linspace(6, 20, 15)
figure = Figure(figsize=(7.0, 4.0), layout="constrained")
axes = figure.subplots()
for name in ("DragonSkin10", "DragonSkin20", "DragonSkin30"):
    most = []
    for length in lengths:
        soft = with_nodus(matrix=read_library().matrices[name], length_mm=length)
        top, has_maximum = speed_of_maximum_thrust(soft)
        most.append(float(evaluate(soft, top).thrust_N) if has_maximum else np.nan)
    axes.plot(lengths, most, label=name)
axes.axhline(1.2 * 9.81 / 4, color="0.5", linestyle="--", label="hover of 1.2 kg")
axes.set(xlabel="length of the nodus [mm]", ylabel="largest thrust [N]", ylim=(0, None))
axes.set_title("The harder silicones carry a quadrotor with margin (law repaired, not validated)")
axes.legend()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "propeller_tour.png", dpi=120)
